# SPDX-License-Identifier: Apache-2.0
"""`python -m geopage`."""

import sys

from geopage.cli import main

sys.exit(main())
