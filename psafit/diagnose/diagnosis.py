"""The diagnosis from beginning to end, and the record it leaves."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from psafit.arrays import FloatArray
from psafit.diagnose import gain as gains
from psafit.diagnose import next_experiment, results
from psafit.diagnose.answer import sentences
from psafit.diagnose.calibration import calibrate as calibrated
from psafit.diagnose.confusable import confusable
from psafit.diagnose.draft import drafted
from psafit.diagnose.explanations import Explanations
from psafit.diagnose.folder import claim, held_in, identity_of, set_aside
from psafit.diagnose.gain import Choice
from psafit.diagnose.influence import influence
from psafit.diagnose.judging import Judgement, judge
from psafit.diagnose.looks import looks
from psafit.diagnose.next_experiment import NextExperiment, Purpose
from psafit.diagnose.record import PREDICTIONS, RESULT, Confusion, Diagnosis
from psafit.diagnose.record.misfit import MisfitResult
from psafit.diagnose.record.models import Apart, CauseResult, ExtensionRun, ScreeningResult
from psafit.diagnose.rehearsal import rehearse, repeat
from psafit.diagnose.retest import retest
from psafit.diagnose.robustness import robustness
from psafit.diagnose.screening import screen
from psafit.diagnose.searching import searched
from psafit.diagnose.settings import Settings
from psafit.diagnose.significance import Significance, looked_up, significance
from psafit.diagnose.trials import Calibration
from psafit.diagnose.verdict import Verdict
from psafit.errors import InputError, check_seed
from psafit.experiment import Experiment, Group, GroupId, write_experiment
from psafit.files import digest, locked, portable_command, sha256
from psafit.forecast import COUNTED, DIAGNOSIS, Silent, Watcher, reporting
from psafit.inference.candidate import Candidate
from psafit.inference.evidence import ImportanceSample
from psafit.inference.laws import broken
from psafit.inference.memory import Memory, lent
from psafit.inference.problem import Problem, refuse_still
from psafit.inference.run import fit
from psafit.inference.run_folder import load, versions
from psafit.inference.samplers import USUAL, sampler
from psafit.inference.samplers.nautilus import NestedEvidence, nested_evidence, require
from psafit.model_search import SearchSettings
from psafit.model_search.model_set import CREDIBLE, ModelSet, key_of
from psafit.numerics import refine
from psafit.physics import TERMS, held_at_work
from psafit.physics.term import Term
from psafit.records import SCHEMA, Broken, ImportanceSummary, write_json
from psafit.validate import predictive, tables_at, validate, write_predictions
from psafit.workers import cores, precompute, reach

_HOW_LONG = (
    "a search ends when no other set of causes comes near: as a rule after half a minute where nothing is wrong, one to"
    " five minutes for one or two causes, half an hour or more for many"
)


def diagnose(
    experiment: Experiment,
    group_ids: Sequence[GroupId],
    folder: Path,
    *,
    quick: bool = False,
    searches: int | None = None,
    nautilus: bool = False,
    calibrate: int = 0,
    seed: int = 1,
    catalogue: Sequence[Term] | None = None,
    settings: Settings | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    draw_on: bool = True,
    watcher: Watcher | None = None,
    command: Sequence[object] = (),
) -> Diagnosis:
    """Diagnose an experiment; what the folder holds the whole answer of is read back.

    Parameters
    ----------
    experiment : Experiment
    group_ids : sequence of group ids
        The training groups of the strict protocol. The verdict uses all groups.
    folder : Path
        Where the result goes; what an interrupted diagnosis has worked out there is used.
    quick : bool
        The verdict alone, by the same search: no measured gain, no proposals beyond the tied causes.
    searches : int, optional
        Repetitions of the whole search on readings simulated from the fitted baseline (`psafit.diagnose.significance`);
        by default as many as the settings say. Without any, the stored table is looked up where a cause is named.
    nautilus : bool
        Whether to compute the evidence of what the verdict rests on by a nested sampler, too.
    calibrate : int
        Data sets that are drawn from the answer and diagnosed again (`psafit.diagnose.calibration`).
    seed : int
    catalogue : sequence of Term, optional
        Candidate causes; all of the catalogue by default. The answer names those that were left out.
    settings : Settings, optional
        How much work goes into each part; `Settings.usual(quick)` by default.
    jobs : int, optional
        Processes that search side by side where several searches are needed; one for every core by default. The result
        does not depend on it.
    scheduler : str, optional
        Address of a Dask scheduler whose workers share the searches instead (extra ``psafit[cluster]``).
    draw_on : bool
        Whether chains of a finished diagnosis that have not converged are drawn on.
    watcher : Watcher, optional
    command : sequence
        Words of the command line, kept with the result.

    Returns
    -------
    Diagnosis
        Also written as `diagnosis.json`.
    """
    training = _training(experiment, group_ids)
    _check(experiment.groups if quick else experiment.select(training), seed, nautilus, scheduler)
    everything = Problem(experiment, experiment.ids, tuple(TERMS if catalogue is None else catalogue))
    catalogue = everything.terms  # with the priors that the experiment states
    settings = settings or Settings.usual(quick)
    left_out = [t.id for t in TERMS if t.id not in everything.ids]
    asked = [training, seed, quick, searches, nautilus, calibrate, asdict(settings), left_out]
    identity = identity_of(everything, asked)
    with locked(folder):
        claim(folder, experiment)
        held = held_in(folder, identity)
        if held and (not draw_on or all(run.converged for run in held.extension.values())):
            return held
        shown, n_jobs = watcher or Silent(), jobs or cores()
        repeats = (settings.searches if searches is None else searches) if catalogue else 0
        plan = _plan(experiment, training, quick, repeats, nautilus, calibrate, n_jobs)
        with reporting(shown, folder, "diagnosis", identity, plan, COUNTED) as shown:
            return Work(
                experiment, training, folder, seed, catalogue, n_jobs, shown, command,
                # What did not converge is drawn on by the command after a finished one, not by one that resumes.
                drawing=held is not None, settings=settings, left_out=left_out, scheduler=scheduler,
            ).all(quick, repeats, nautilus, identity, calibrate)  # fmt: skip


def _check(groups: Sequence[Group], seed: int, nautilus: bool, scheduler: str | None) -> None:
    """Refuse what would fail after hours of work."""
    refuse_still(groups)
    check_seed(seed)
    if nautilus:
        require()
    if scheduler is not None:
        reach(scheduler)


def _training(experiment: Experiment, group_ids: Sequence[GroupId]) -> tuple[GroupId, ...]:
    """The groups of these names in the experiment's order, so that they are the same work however they were named."""
    training = tuple(experiment.group(g).id for g in group_ids)
    if not training:
        raise InputError("no training group", "give at least one group id")
    Problem(experiment, training)  # refuses what cannot be fitted, before hours of work on all groups
    return tuple(g for g in experiment.ids if g in training)


def _plan(
    experiment: Experiment,
    training: tuple[GroupId, ...],
    quick: bool,
    repeats: int,
    nautilus: bool,
    drawn: int,
    jobs: int,
) -> dict[str, float]:
    """Shares of a diagnosis' parts, in units of one search over all groups: see `psafit.forecast.DIAGNOSIS`.

    It takes for granted that causes are named: without, the repeated searches and the samplers fall away.
    """
    one = DIAGNOSIS
    found = {"causes": one["search"] / min(jobs, 2), "tests": one["tests"], "next experiment": one["proposals"]}
    found["other causes"] = one["others"]
    protocols = {} if quick else gains.protocols(experiment, training)
    parts = sum(map(len, protocols.values()))
    if parts:
        found["parts"] = one["again"] * parts / min(jobs, parts) + one["search"] / min(jobs, 2)
    strict, nested = (bool(protocols.get(name)) for name in ("strict", "nested"))
    if strict:
        found["strict gain"] = one["gain"]
    if nested:
        found["nested gain"] = one["gain"]
    if not quick:
        found["adopted extension"] = one["sampler"]
    if strict:
        found["strict extension"] = one["sampler"]
    if repeats:
        found["significance"] = one["null"] * repeats / min(jobs, repeats)
    if nautilus:
        found["nautilus"] = one["nautilus"]
    if drawn:
        found["calibration"] = (one["search"] + one["tests"]) * drawn / min(jobs, drawn)
    return found


@dataclass(eq=False)
class Work:
    """One diagnosis: what its stages share, and the stages."""

    experiment: Experiment
    training: tuple[GroupId, ...]
    folder: Path
    seed: int
    catalogue: Sequence[Term]
    jobs: int
    watcher: Watcher
    command: Sequence[object]
    drawing: bool = False
    settings: Settings = field(default_factory=Settings)
    left_out: Sequence[str] = ()
    scheduler: str | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    _model_sets: dict[tuple[tuple[GroupId, ...], tuple[Candidate, ...]], ModelSet] = field(default_factory=dict)

    def all(self, quick: bool, repeats: int, nautilus: bool, identity: str, drawn: int = 0) -> Diagnosis:
        """Every stage in turn, and the record."""
        experiment = self.experiment
        with self._stage("causes", "" if self.drawing else _HOW_LONG):
            model_set = self.search(experiment.ids)
        best_model = model_set.best_model
        with self._stage("tests"):
            judgement = judge(model_set, self.catalogue, self.settings, seed=self.seed)
            verdict, adopted = judgement.verdict, judgement.adopted
            misfit, laws = self._tested(judgement)
        draws = model_set.draws(adopted.ids, self.seed).resampled(self.settings.draws)
        if not self.drawing:
            set_aside(self.folder)
        write_experiment(experiment, self.folder / "experiment")  # for whoever draws the page again
        numerics = refine(adopted.problem, adopted.modes[:1], experiment.fingerprint)
        write_predictions(self.folder / PREDICTIONS, predictive(adopted.problem, draws, self.seed))
        with self._stage("next experiment"):
            most = self.settings.rehearsed
            proposal = _next(judgement, self.seed, most, None if quick else self.watcher)
            confusion = Confusion() if quick else _confusion(model_set, verdict, self.seed, most, self.watcher)
            confusion = replace(confusion, alike=confusable(adopted, self.catalogue))
        ledger = [Choice("verdict, causes named, their probabilities", list(experiment.ids), [])]
        measured = {} if quick else self.gains_of(model_set)
        ledger += [choice for scored in measured.values() for choice in scored.ledger]
        extension = {} if quick or not self.settings.steps else self._extensions(verdict.named, measured, ledger)
        if repeats or (verdict.named and self.catalogue):
            misfit = replace(misfit, search=self._significance(model_set, repeats))
        causes = results.causes_of(model_set, verdict)
        with self._stage("other causes"):
            screening = self._screened(model_set, verdict)
        if nautilus:
            decisive = [set(ids) for ids in ((), verdict.named, best_model.ids, *verdict.alternatives)]
            with self._stage("nautilus"):
                causes = [self._confirmed(c, model_set) if set(c.terms) in decisive else c for c in causes]
        result = Diagnosis(
            schema=SCHEMA,
            verdict=verdict.verdict,
            named=list(verdict.named),
            alternatives=[list(ids) for ids in verdict.alternatives],
            causes=causes,
            looked_at=model_set.looked_at,
            misfit=misfit,
            numerics=numerics,
            gain=measured,
            next_experiment=proposal,
            predictions=PREDICTIONS,
            files=_seals(self.folder, measured),
            laws=laws,
            unexplained_by=verdict.unexplained_by,
            by_likelihood=[list(ids) for ids in verdict.by_likelihood],
            counted=results.counted_of(model_set, judgement.adopted),
            without=results.without_of(model_set, verdict.named),
            looks=looks(causes, verdict, self.catalogue),
            sentences=[],
            unnamed=verdict.unnamed,
            screening=screening,
            show=results.shown(model_set),
            extension=extension,
            ledger=ledger,
            title=experiment.title,
            fingerprint=experiment.fingerprint,
            groups=list(experiment.ids),
            training=list(self.training),
            seed=self.seed,
            quick=quick,
            versions=versions(),
            command=portable_command(self.command),
            seconds=self.seconds,
            confusion=confusion,
            identity=identity,
            left_out=list(self.left_out),
            settings=self.settings,
            calibration=self._calibration(model_set, drawn),
            influence=influence(model_set, verdict.named, seed=self.seed, draws=self.settings.draws),
            draft=drafted(judgement, self.folder),
        )
        result = replace(result, sentences=sentences(result, experiment.beliefs))
        write_json(self.folder / RESULT, result, sealed=True)
        return result

    def _screened(self, model_set: ModelSet, verdict: Verdict) -> list[ScreeningResult]:
        """Every cause, what it gains by itself, and what given the best model."""
        best_model = model_set.best_model
        given_best = screen(best_model, self.catalogue) if verdict.verdict != "adequate" and best_model.terms else []
        alone = screen(model_set.baseline, self.catalogue)
        return results.screening_of(alone, given_best, model_set, verdict, self.seed)

    def _tested(self, judgement: Judgement) -> tuple[MisfitResult, list[Broken]]:
        """What the tests say of the baseline and the best model, and the laws that reported models break."""
        model_set, verdict, left = judgement.model_set, judgement.verdict, judgement.left
        best_model = model_set.best_model
        reported = [judgement.adopted, *map(model_set.of, verdict.alternatives)]
        laws = [law for model in reported for law in broken(model, self.settings.laws)]
        misfit = results.misfit_of(
            judgement.before, judgement.after, left, model_set.baseline, best_model,
            firm=robustness(model_set.baseline, best_model, judgement.bare, left) if best_model.terms else None,
        )  # fmt: skip
        return misfit, laws

    def _extensions(
        self, named: tuple[str, ...], measured: dict[str, gains.Gain], ledger: list[Choice]
    ) -> dict[str, ExtensionRun]:
        """Draw the posteriors of the named model and, where it is measured, of the strict protocol's."""
        found: dict[str, ExtensionRun] = {}
        runs = {"adopted": (named, self.experiment.ids)}
        if "strict" in measured:
            runs["strict"] = (tuple(measured["strict"].groups[0].named), self.training)
        for which, (ids, groups) in runs.items():
            if ids:
                self.watcher.part(f"{which} extension")
                with self._timed(f"{which} extension"):
                    found[which] = self.extend(ids, groups)
                ledger.append(Choice(f"posterior of the extension ({which})", list(groups), found[which].scored_on))
        return found

    @cached_property
    def _memory(self) -> Memory:
        return Memory(self.folder / "steps")

    @contextmanager
    def _timed(self, name: str) -> Iterator[None]:
        began = time.monotonic()
        yield
        self.seconds[name] = round(time.monotonic() - began, 3)

    @contextmanager
    def _stage(self, name: str, remark: str = "") -> Iterator[None]:
        self.watcher.stage(name)
        if remark:
            logging.getLogger(__name__).info("%s", remark)
        with self._timed(name):
            yield

    def _searched(self, done: int, total: int) -> None:
        """Report searches that run side by side."""
        self.watcher.part("parts", done / total)
        self.watcher.update(done, total, f"searches; {self._memory.count('short')} short fits kept")

    def search(self, groups: tuple[GroupId, ...], starts: tuple[Candidate, ...] = ()) -> ModelSet:
        """The model set of what some groups say."""
        absent = [str(g) for g in self.experiment.ids if g not in groups]
        which = f"without {', '.join(absent)}: " if absent else ""

        def progress(what: str) -> None:
            # What is likely changes as the search goes on: nobody can know how much is left.
            self.watcher.update(0, None, which + what)

        if (groups, starts) not in self._model_sets:
            self._model_sets[groups, starts] = _model_set_of(
                self._memory, *self._common, groups, starts, self.jobs, self.scheduler, progress
            )
        return self._model_sets[groups, starts]

    @property
    def _common(self) -> tuple[Experiment, Sequence[Term], int, SearchSettings]:
        """What all searches of this diagnosis share."""
        return self.experiment, self.catalogue, self.seed, self.settings.search

    def gains_of(self, whole: ModelSet) -> dict[str, gains.Gain]:
        """What the extension gains on groups that it has not seen, for each protocol.

        The searches of the nested protocol begin at the sets that all groups have led to: places are computation, and
        what is said rests on the groups that were seen alone. One is repeated from nothing, to see what that changes.
        """
        protocols = gains.protocols(self.experiment, self.training)
        sampled = tuple(c for c in whole.candidates if c.ids and c.ids in whole.samples)
        starts: dict[str, tuple[Candidate, ...]] = {"strict": (), "nested": sampled}
        splits_of = [(seen, starts[name]) for name, splits in protocols.items() for seen, _ in splits]
        audited = protocols["nested"][0] if protocols["nested"] and sampled else None
        wanted = list(dict.fromkeys([*splits_of, *([(audited[0], ())] if audited else [])]))
        found = {}
        with self._stage("parts"):
            self._memory.begin()
            calls = [(_model_set_of, self._memory, *self._common, *one) for one in wanted]
            precompute(lent, calls, self.jobs, self._searched, scheduler=self.scheduler, take=self._memory.receive)
            for k, one in enumerate(wanted, 1):
                found[one] = self.search(*one)
                self.watcher.part("parts", k / len(wanted))
        measured = {}
        for protocol, splits in protocols.items():
            if splits:
                with self._stage(f"{protocol} gain"):
                    done = [
                        gains.split(found[seen, starts[protocol]], held_out, self.seed, self.settings.draws)
                        for seen, held_out in splits
                    ]
                    measured[protocol] = gains.summarise(protocol, done, self.folder, self.seed)
        if audited:
            seen, _ = audited
            about = found[seen, sampled], found[seen, ()], self.experiment.ids, seen
            measured["nested"].ledger.extend(gains.audit(*about))
        return measured

    def _significance(self, model_set: ModelSet, repeats: int) -> Significance:
        """How often a search finds as much where nothing is hidden."""
        if not repeats:
            return looked_up(model_set, self.catalogue, self.settings.search)
        with self._stage("significance"):
            return significance(
                model_set, self.catalogue, repeats, seed=self.seed, memory=self._memory, settings=self.settings.search,
                jobs=self.jobs, scheduler=self.scheduler,
                progress=lambda k, n: self.watcher.update(k, n, "simulated baselines"),
            )  # fmt: skip

    def _calibration(self, model_set: ModelSet, drawn: int) -> Calibration | None:
        """How often such a verdict is right here, where that is asked for."""
        if not drawn:
            return None
        with self._stage("calibration"):
            return calibrated(
                model_set, self.catalogue, drawn, seed=self.seed, memory=self._memory, settings=self.settings,
                jobs=self.jobs, scheduler=self.scheduler,
                progress=lambda k, n: self.watcher.update(k, n, "data sets drawn from the answer"),
            )  # fmt: skip

    def extend(self, ids: Sequence[str], groups: Sequence[GroupId]) -> ExtensionRun:
        """Fit causes to groups like any run, sample their posterior, and validate it."""
        terms = tuple(t for t in self.catalogue if t.id in ids)
        problem = Problem(self.experiment, tuple(groups), terms)
        settings, steps = sampler(USUAL).settings(problem), self.settings.steps
        # A diagnosis repeated in its folder with other groups, priors or another seed is another run.
        about = [versions(), list(groups), self.seed, *(t.determinants for t in terms)]
        about += [p.signature for p in problem.parameters]
        # Where the search has found them: a fit from scratch of six causes ended 190 nats below.
        found = self.search(tuple(groups)).of(tuple(t.id for t in terms))
        # (To ten digits: a run is known by them, on any machine.)
        known = [
            {name: float(f"{value:.10g}") for name, value in zip(problem.names, at, strict=True)}
            for at in problem.to_physical(found.modes)
        ]
        about += [known, steps]
        place = f"extension-{'-'.join(t.id for t in terms)[:100]}-{digest(about)[:8]}"
        if (self.folder / place / "posterior.json").exists() and not self.drawing:
            run = load(self.folder / place)
        else:
            run = fit(
                self.experiment,
                groups,
                self.folder / place,
                terms=terms,
                seed=self.seed,
                known=known,
                settings=replace(settings, max_steps=steps),
                watcher=self.watcher,
                command=self.command,
            )
        validation, _ = validate(run, retest=retest)
        return ExtensionRun(
            folder=place,
            groups=list(groups),
            terms=[t.id for t in terms],
            scored_on=[s.group for s in validation.groups if s.role == "holdout"],
            converged=run.summary.converged,
            message=run.summary.message,
            importance=_apart(run.summary.importance),
            holdout_log_rmse=validation.holdout_log_rmse,
        )

    def _confirmed(self, cause: CauseResult, model_set: ModelSet) -> CauseResult:
        """A model's result, with the evidence of a nested sampler added."""
        problem = next(c for c in model_set.candidates if set(c.ids) == set(cause.terms)).problem

        def progress(calls: int) -> None:
            self.watcher.update(0, 1, f"{key_of(cause.terms)}: {calls:,} sets")

        def make() -> dict[str, FloatArray]:
            found = nested_evidence(problem, seed=self.seed, progress=progress)
            return {name: np.asarray(value, float) for name, value in asdict(found).items()}

        found = self._memory.recall("nautilus", problem, [self.seed], make)
        nautilus = NestedEvidence(float(found["log_evidence"]), float(found["effective_draws"]), int(found["calls"]))
        return replace(cause, evidence=replace(cause.evidence, nautilus=nautilus))


def _apart(other: ImportanceSummary) -> Apart:
    """How far a chain and importance draws are apart."""
    worst = other.furthest
    return Apart(worst.name, worst.apart, other.by_chance, other.effective)


def _model_set_of(
    memory: Memory,
    experiment: Experiment,
    catalogue: Sequence[Term],
    seed: int,
    settings: SearchSettings,
    groups: tuple[GroupId, ...],
    starts: Sequence[Candidate] = (),
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Callable[[str], None] = lambda what: None,
) -> ModelSet:
    """The model set of what some groups say."""
    # What the rig is held to have counts for the values of the answer alone, which rests on all groups.
    believed = held_at_work(experiment.beliefs) if groups == experiment.ids else {}
    return searched(
        Problem(experiment, groups), catalogue, seed=seed, settings=settings, memory=memory, jobs=jobs,
        scheduler=scheduler, starts=starts, held=[t.id for t in catalogue if t.id in believed], progress=progress,
    )  # fmt: skip


def _seals(folder: Path, measured: Mapping[str, gains.Gain]) -> dict[str, str]:
    """SHA-256 of each table of predictions."""
    tables = [PREDICTIONS, *(one.predictions for one in measured.values())]
    return {file.name: sha256(file) for name in tables for file in tables_at(folder / name).values()}


def _tied(model_set: ModelSet, verdict: Verdict, seed: int, most: int) -> list[tuple[Candidate, ImportanceSample]]:
    """What is adopted and what does as well, with draws of their posteriors.

    Of an adequate baseline that is the cause that it excludes least, if one keeps a twentieth. Where nothing does as
    well, and the model is not wrong, it is what counts though it does not show.
    """
    if verdict.verdict == "adequate":
        causes = [ids for ids in model_set.by_probability(()) if model_set.probability[ids] >= 1 - CREDIBLE]
        equals = [(), *causes[:1]]
    else:
        equals = [model_set.best_model.ids, *verdict.alternatives]
    if len(equals) == 1 and verdict.verdict != "unexplained":
        equals += results.counted_sets(model_set, equals[0])[:1]
    return [(model_set.of(ids), draws) for ids, draws in model_set.drawn(equals[:most], seed).items()]


def _confusion(model_set: ModelSet, verdict: Verdict, seed: int, most: int, watcher: Watcher) -> Confusion:
    """Whether tied models could be distinguished by the same conditions, measured again."""
    if not (verdict.named and verdict.alternatives):
        return Confusion()
    tied = _tied(model_set, verdict, seed, most)
    if len(tied) < 2:
        return Confusion()
    prior = [model_set.log_prior(c.ids) for c, _ in tied]
    found = repeat(tied, prior, seed=seed, progress=lambda k, n: watcher.update(k, n, "experiments repeated"))
    return Confusion([], found.proposal, found.truth, found.before, found.after, found.first)


def _next(judgement: Judgement, seed: int, most: int, watcher: Watcher | None) -> NextExperiment:
    """Proposals for the verdict at hand: by what is left, against the best rival, or for a weakly determined parameter.

    With a watcher the best is rehearsed, and the best that leaves the rig as it is.
    """
    model_set, verdict = judgement.model_set, judgement.verdict
    if not any(g.driven.any() for g in model_set.best_model.problem.experiment.groups):
        return NextExperiment()
    if verdict.structured and (left := Explanations.of(model_set.best_model, judgement.left)):
        left = left.worth_distinguishing(1 - CREDIBLE)
        found = next_experiment.explaining(left, (judgement.after or judgement.before).stretches, seed=seed)
        return NextExperiment.of(found, Purpose("explain", explanations=left.record))
    tied = _tied(model_set, verdict, seed, most)
    if len(tied) == 1:
        name, found = next_experiment.determine(*tied[0], seed=seed)
        weak = next_experiment.is_weak(*tied[0], name)
        return NextExperiment.of(found, Purpose("narrow", parameter=name), weak)
    found = next_experiment.separating(tied, seed=seed)
    result = NextExperiment.of(found, Purpose("separate", [list(c.ids) for c, _ in tied]))
    if watcher is not None and verdict.alternatives:
        prior = [model_set.log_prior(c.ids) for c, _ in tied]
        here = [p for p in found if p.as_it_is][:1]
        rehearsals = [
            rehearse(tied, prior, p, seed=seed, progress=lambda k, n: watcher.update(k, n, "rehearsals"))
            for p in {p.text: p for p in result.proposals[:1] + here}.values()
        ]
        return replace(result, rehearsals=rehearsals)
    return result
