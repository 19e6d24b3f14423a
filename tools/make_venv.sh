#!/bin/sh
# Makes a virtual environment with the bpy module, embreex and the development tools.
# Environment: PYTHON (python3.11), VENV (.venv), BPY (4.5.15).
set -eu
PYTHON="${PYTHON:-python3.11}"
VENV="${VENV:-.venv}"
BPY="${BPY:-4.5.15}"

if ! "$PYTHON" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null; then
    echo "The bpy module needs Python 3.11 exactly, and '$PYTHON' is not it." >&2
    echo "Cure: install Python 3.11 (Debian 12: apt install python3.11 python3.11-venv) or call make PYTHON=/path/to/python3.11" >&2
    exit 1
fi
if ! "$PYTHON" -m venv "$VENV"; then
    echo "Cure: apt install python3.11-venv" >&2
    exit 1
fi
rm -f "$VENV"/installed-*
"$VENV/bin/python" - > "$VENV/requirements.txt" <<EOF
import tomllib
project = tomllib.load(open("pyproject.toml", "rb"))["project"]
print(*project["dependencies"], *project["optional-dependencies"]["dev"], "bpy==$BPY", sep="\n")
EOF
"$VENV/bin/python" -m pip install --quiet --disable-pip-version-check -r "$VENV/requirements.txt"
if ! "$VENV/bin/python" -c 'import bpy'; then
    echo "The bpy module does not load; on Debian it needs these system libraries:" >&2
    echo "Cure: apt install libx11-6 libxrender1 libxfixes3 libxi6 libxkbcommon0 libsm6 libgl1" >&2
    exit 1
fi
touch "$VENV/installed-$BPY"
