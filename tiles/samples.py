# SPDX-License-Identifier: Apache-2.0
"""Where the sample data lies: beside the packages, in a checkout and when installed."""

from pathlib import Path

SAMPLES = Path(__file__).resolve().parent.parent / "data_samples"
PATHS = SAMPLES / "paths"
