#!/usr/bin/env python3
"""Score a denoiser on held-out views: `evaluate.py kpcn`, `evaluate.py bilateral`."""

import sys

from quietlight_training import bilateral_evaluate, kpcn_evaluate
from quietlight_training.verbs import Subcommand, run_verb

SUBCOMMANDS = {
    "bilateral": Subcommand("the bilateral filter", bilateral_evaluate.add_arguments, bilateral_evaluate.run),
    "kpcn": Subcommand("the kernel-predicting network", kpcn_evaluate.add_arguments, kpcn_evaluate.run),
}

if __name__ == "__main__":
    sys.exit(run_verb("Score a denoiser on held-out views.", SUBCOMMANDS))
