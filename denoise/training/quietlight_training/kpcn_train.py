"""Trains the kernel-predicting network."""

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `train.py kpcn`."""
    parser.add_argument("--config", required=True)


def run(args: argparse.Namespace) -> None:
    """Trains."""
