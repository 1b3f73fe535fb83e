"""The shell of a verb that knows several denoisers: one subcommand each."""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Subcommand:
    """What a verb does for one denoiser: `add_arguments(parser)` declares the options, `run(args)` does it."""

    help: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], None]


def run_verb(description: str, subcommands: dict[str, Subcommand], arguments: list[str] | None = None) -> int:
    """Parses the command line, runs the subcommand it names and returns the exit code.

    Bad input (`ValueError`, `FileNotFoundError`) is one line on stderr and 2; a fault keeps its trace.
    """
    parser = argparse.ArgumentParser(description=description)
    parsers = parser.add_subparsers(dest="denoiser", required=True)
    for name, subcommand in subcommands.items():
        subcommand.add_arguments(
            parsers.add_parser(
                name, help=subcommand.help, formatter_class=argparse.ArgumentDefaultsHelpFormatter
            )
        )
    args = parser.parse_args(arguments)
    try:
        subcommands[args.denoiser].run(args)
    except (FileNotFoundError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0
