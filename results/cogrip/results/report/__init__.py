"""HTML reports of one run or of several compared."""
