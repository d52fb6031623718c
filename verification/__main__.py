"""Lists the programs of this folder: ``python -m verification``."""

import ast
from pathlib import Path

for path in sorted(Path(__file__).parent.glob("*.py")):
    text = path.read_text(encoding="utf-8")
    if "\n    run_program(" in text:
        says = str(ast.get_docstring(ast.parse(text))).partition("\n")[0]
        print(f"python -m verification.{path.stem:<19}{says}")
