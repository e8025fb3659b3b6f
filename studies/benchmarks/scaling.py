import argparse
def scaling(options: argparse.Namespace) -> None:
    """x"""
