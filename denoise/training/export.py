"""Turn a checkpoint into the weight files that the renderer embeds: `export.py kpcn`."""

import sys

from quietlight_training import kpcn_export
from quietlight_training.verbs import Subcommand, run_verb

SUBCOMMANDS = {
    "kpcn": Subcommand("the kernel-predicting network", kpcn_export.add_arguments, kpcn_export.run),
}

if __name__ == "__main__":
    sys.exit(run_verb("Turn a checkpoint into the weight files that the renderer embeds.", SUBCOMMANDS))
