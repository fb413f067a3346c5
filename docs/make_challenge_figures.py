"""Draw the figures of docs/challenge.md from the campaign that `make challenge` leaves in fits/challenge."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RUN = ROOT / "fits" / "challenge"


def main() -> int:
    if not (RUN / "campaign.json").exists():
        print("no fits/challenge: run make challenge first; the figures of the campaign stay as they are")
        return 0
    from psafit.challenge.campaign import load
    from psafit.challenge.score import score
    from psafit.report.challenge import draw
    from psafit.report.style import figure_style

    with figure_style():
        for name, figure in draw(score(load(RUN)[1])).items():
            if name in ("gain", "reliability"):
                figure.savefig(ROOT / "docs" / "figures" / f"challenge-{name}.png", dpi=150)
    return 0


if __name__ == "__main__":
    sys.exit(main())
