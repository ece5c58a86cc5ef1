"""Adds to CppADCodeGen's base types the members that Pinocchio asks of any scalar: usage complete_cppad.py FOLDER."""

import re
import sys
from pathlib import Path

for scalar in ("float", "double"):
    header = Path(sys.argv[1]) / f"base_{scalar}.hpp"
    text = header.read_text()
    if "max_digits10" in text:
        continue
    anchor = re.search(rf"    static const int digits10\s*= std::numeric_limits<{scalar}>::digits10;\n", text)
    members = (
        f"    static const int max_digits10 = std::numeric_limits<{scalar}>::max_digits10;\n"
        f"    static cg::CG<{scalar}> infinity() {{ return std::numeric_limits<{scalar}>::infinity(); }}\n"
    )
    header.write_text(text[: anchor.end()] + members + text[anchor.end() :])
