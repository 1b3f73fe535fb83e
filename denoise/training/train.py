#!/usr/bin/env python3
"""Train a denoiser: `train.py kpcn`, `train.py bilateral`."""

import sys

from quietlight_training import bilateral_train, kpcn_train
from quietlight_training.verbs import Subcommand, run_verb

SUBCOMMANDS = {
    "bilateral": Subcommand("the network of the bilateral filter", bilateral_train.add_arguments, bilateral_train.run),
    "kpcn": Subcommand("the kernel-predicting network", kpcn_train.add_arguments, kpcn_train.run),
}

if __name__ == "__main__":
    sys.exit(run_verb("Train a denoiser.", SUBCOMMANDS))
