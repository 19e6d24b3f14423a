#!/bin/sh
# Prints the path of a Python of this version: from PATH, from pyenv, or from PYTHON_FOLDER
# (~/.cache/obscurance_addon/pythonVERSION). With --install a missing one is installed by apt or, where this Debian has none,
# compiled from another Debian's source into that folder (three minutes on two processors; needs root).
# Usage: find_python.sh [--install] 3.11|3.13
set -eu
INSTALL=no
if [ "$1" = --install ]; then
    INSTALL=yes
    shift
fi
VERSION="$1"
FOLDER="${PYTHON_FOLDER:-${XDG_CACHE_HOME:-$HOME/.cache}/obscurance_addon/python$VERSION}"

find_it() {
    for python in "python$VERSION" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$VERSION".*/bin/"python$VERSION" \
        "$FOLDER/bin/python$VERSION"; do
        # A shim of pyenv may be in PATH and yet not run, and Debian has ensurepip in a package of its own.
        if "$python" -c 'import bz2, ctypes, ensurepip, lzma, ssl, venv, zlib' 2>/dev/null; then
            command -v "$python"
            exit 0
        fi
    done
}

compile() { # from the source of the Debian that has this version
    case "$VERSION" in
        3.11) SUITE=bookworm ;;
        3.13) SUITE=trixie ;;
        *) echo "No Debian is known to have Python $VERSION" >&2; exit 1 ;;
    esac
    apt-get install -qy --no-install-recommends \
        build-essential pkg-config dpkg-dev libssl-dev zlib1g-dev libffi-dev libbz2-dev liblzma-dev libsqlite3-dev
    WORK="$(mktemp -d)"
    trap 'rm -rf "$WORK"' EXIT
    chmod 755 "$WORK" # apt reads it as a user of its own
    mkdir -p "$WORK/lists/partial" "$WORK/cache/archives/partial" "$WORK/code"
    MIRROR="$(sed -n 's/^URIs: *\(.*debian\)$/\1/p; s/^deb \([^ ]*debian\) .*/\1/p' \
        /etc/apt/sources.list.d/debian.sources /etc/apt/sources.list 2>/dev/null | head -n 1)"
    KEYS=/usr/share/keyrings/debian-archive-keyring.gpg
    echo "deb-src [signed-by=$KEYS] $MIRROR $SUITE main" > "$WORK/source.list"
    cd "$WORK"
    for step in update "source --download-only python$VERSION"; do
        # shellcheck disable=SC2086
        apt-get -q -o Dir::Etc::SourceList="$WORK/source.list" -o Dir::Etc::SourceParts=- \
            -o Dir::State::Lists="$WORK/lists" -o Dir::Cache="$WORK/cache" \
            -o APT::Sandbox::User=root -o Acquire::Check-Valid-Until=false $step
    done
    tar -xf "python${VERSION}"_*.orig.tar.xz --strip-components=1 -C code
    cd code
    ./configure -q --prefix="$FOLDER"
    make -s "-j$(nproc)" > /dev/null
    make -s install > /dev/null
}

find_it
if [ $INSTALL = no ] || [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "There is no Python $VERSION here." >&2
    echo "Cure: as root on Debian 'sh tools/find_python.sh --install $VERSION'; or install it and call make PYTHON=/path/to/python$VERSION" >&2
    exit 1
fi
{
    apt-get update -q
    apt-get install -qy --no-install-recommends "python$VERSION" "python$VERSION-venv" || (compile)
} >&2
find_it
echo "Python $VERSION was installed and does not run" >&2
exit 1
