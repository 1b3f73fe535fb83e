"""Exports a kernel-predicting network."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `export.py kpcn`."""
    parser.add_argument("--config", required=True)


def run(args: argparse.Namespace) -> None:
    """Exports."""
