"""Train a denoiser on preprocessed views: `train.py kpcn`."""

import sys

from quietlight_training import kpcn_train
from quietlight_training.verbs import Subcommand, run_verb

SUBCOMMANDS = {
    "kpcn": Subcommand("the kernel-predicting network", kpcn_train.add_arguments, kpcn_train.run),
}

if __name__ == "__main__":
    sys.exit(run_verb("Train a denoiser on preprocessed views.", SUBCOMMANDS))
