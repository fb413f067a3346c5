"""From measurements to a posterior: scatter, priors, likelihood, search, sampling, identifiability."""
