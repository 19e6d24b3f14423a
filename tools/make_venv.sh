#!/bin/sh
# Makes a virtual environment with the bpy module, embreex and the development tools.
# Environment: BPY (4.5.15), VENV (.venv), PYTHON (the one that this bpy needs, looked for by find_python.sh).
set -eu
VENV="${VENV:-.venv}"
BPY="${BPY:-4.5.15}"
case "$BPY" in
    4.* | 5.0.*) VERSION=3.11 ;;
    *) VERSION=3.13 ;;
esac
PYTHON="${PYTHON:-$(sh "$(dirname "$0")/find_python.sh" "$VERSION")}"

if [ "$("$PYTHON" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)" != "$VERSION" ]; then
    echo "bpy $BPY needs Python $VERSION exactly, and '$PYTHON' is not it." >&2
    echo "Cure: call make PYTHON=/path/to/python$VERSION, or without PYTHON to have it looked for" >&2
    exit 1
fi
if ! "$PYTHON" -m venv "$VENV"; then
    echo "Cure: apt install python$VERSION-venv" >&2
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
