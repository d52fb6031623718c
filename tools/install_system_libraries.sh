#!/bin/sh
# The system libraries that SUMO's wheels need, and what the tests of sumo-gui and of pages need.
set -eu
packages="libx11-6 libxext6 libxrender1 libgl1 libglu1-mesa xvfb chromium"
[ "$(uname -s)" = Linux ] && command -v dpkg-query >/dev/null || exit 0
missing=""
for package in $packages; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' \
        || missing="$missing $package"
done
[ -n "$missing" ] || exit 0
if [ "$(id -u)" = 0 ]; then sudo=""; elif command -v sudo >/dev/null; then sudo=sudo; else
    echo "Install these packages as root first: apt-get install$missing" >&2
    exit 1
fi
$sudo apt-get update -qq
# shellcheck disable=SC2086
$sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing
