# SPDX-License-Identifier: Apache-2.0
"""`geopage paging`: the numbers of paging beside their limits, in one document."""
