#!/bin/sh
# Build the wheel, check it with twine, and drive with it in a fresh environment of each Python, from
# another directory: sh tools/try_wheel.sh FOLDER PYTHON...
set -eu
folder=$1
shift
root=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
"$1" -m venv "$folder/build"
"$folder/build/bin/python" -m pip install --quiet build twine
rm -rf "$folder/tree" "$folder/dist"
mkdir "$folder/tree"
git -C "$root" archive HEAD | tar -x -C "$folder/tree"
"$folder/build/bin/python" -m build --outdir "$folder/dist" "$folder/tree" >"$folder/build.txt" 2>&1
"$folder/build/bin/python" -m twine check --strict "$folder"/dist/*
for python in "$@"; do
    name=$("$python" -c 'import platform; print("python" + platform.python_version())')
    rm -rf "$folder/$name"
    "$python" -m venv "$folder/$name"
    "$folder/$name/bin/python" -m pip install --quiet -c "$root/constraints.txt" "$folder"/dist/*.whl
    cd "$folder"
    echo "$name, $(du -sm "$name" | cut -f1) MB without torch"
    "$name/bin/drl-av" evaluate pretrained idm-mobil --vehicles 20 --episodes 2 --seed 800000
    "$name/bin/drl-av" replay --vehicles 5 --seed 800000 --decisions 3 --video "$name/drive.gif"
    "$name/bin/python" -m verification.crash_rate --driver gap-mobil --tests 2 --careless 0.5
    "$name/bin/drl-av" train --out "$name/run" --episodes 1 && exit 1
    "$name/bin/python" - <<'PROGRAM'
import gymnasium
import drl_av

env = drl_av.RecordVideo(gymnasium.make("drl_av/Highway-v0"), "films", lambda episode: True)
env.reset(seed=1)
print("reward of a decision:", env.step(1)[1])
env.close()
PROGRAM
done
