#!/bin/sh
# Makes a folder with a Debian in it that has a real Blender, a virtual screen and software OpenGL (1.8 GB, two minutes).
# Needs root and debootstrap. Usage: debian_blender.sh SUITE FOLDER
#   trixie: Blender 4.3, Python 3.13, which the wheels of the extension serve
#   sid:    the newest Blender; wheels for its Python are downloaded or compiled into FOLDER/wheels
set -eu
SUITE="$1"
FOLDER="$2"
PACKAGES="blender xvfb xauth libgl1-mesa-dri imagemagick python3-numpy python3-requests python3-zstandard"
[ "$SUITE" = trixie ] || PACKAGES="$PACKAGES python3-cattr python3-pip python3-dev g++ cmake ninja-build"

if [ -e "$FOLDER/complete" ]; then
    exit 0
fi
if [ "$(id -u)" != 0 ]; then
    echo "A Debian in a folder needs root: run as root, or test in your own Blender" >&2
    exit 1
fi
if ! command -v debootstrap >/dev/null; then
    echo "Cure: apt install debootstrap" >&2
    exit 1
fi

inside() { # run a command in the folder; the mounts vanish with it
    unshare --mount sh -eu -c '
        mount --bind /proc "$0/proc"; mount --bind /dev "$0/dev"; mount --bind /etc/ssl/certs "$0/etc/ssl/certs"
        exec chroot "$0" "$@"' "$FOLDER" "$@"
}

MIRROR="$(sed -n 's/^URIs: *\(.*debian\)$/\1/p; s/^deb \([^ ]*debian\) .*/\1/p' /etc/apt/sources.list.d/debian.sources \
    /etc/apt/sources.list 2>/dev/null | head -n 1)"
rm -rf "$FOLDER"
mkdir -p "$(dirname "$FOLDER")"
debootstrap --variant=minbase --include=ca-certificates "$SUITE" "$FOLDER" "$MIRROR"
inside apt-get -o Acquire::Check-Valid-Until=false -q update
# shellcheck disable=SC2086
inside env DEBIAN_FRONTEND=noninteractive apt-get install -qy --no-install-recommends $PACKAGES
if [ "$SUITE" != trixie ]; then
    REQUIRED="$(sed -n 's/.*wheels\/\([a-z]*\)-\([0-9a-z.]*\)-cp31[13]-\(cp313\|abi3\)-win.*/\1==\2/p' "$(dirname "$0")/../blender_manifest.toml")"
    # shellcheck disable=SC2086
    inside env PIP_CERT=/etc/ssl/certs/ca-certificates.crt python3 -m pip wheel --quiet --no-deps -w /wheels $REQUIRED
fi
mkdir -p "$FOLDER/mnt/checkout" "$FOLDER/mnt/run"
touch "$FOLDER/complete"
