#!/usr/bin/env bash
# The same gaits on the same robots in our two engines and in MuJoCo: speed, fidelity, agreement. See README.md beside this.
#
#   tests/peers/run.sh                      measure the quadropod and the lizard (some minutes; a quiet machine, please)
#   tests/peers/run.sh ROBOT …              measure these robots that ship, NAME:VARIANT, random:INDEX
#   tests/peers/run.sh --brief ROBOT …      only defaults and finest settings: a line a robot
#   tests/peers/run.sh --import [COUNT]     check that random MJCF files are imported as the robots that MuJoCo has
#   tests/peers/run.sh --standing [COUNT]   check that random robots come to rest here as they do in MuJoCo
#   tests/peers/run.sh --quick              check that all engines have the same robots, and a little of the above (CI)
#   tests/peers/run.sh --help               all options
#
# PEERS_PROFILE=dev uses an unoptimised build of our command: good for correctness, not for speeds.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."
target=${CARGO_TARGET_DIR:-target}
profile=${PEERS_PROFILE:-release}
venv=$target/peers/venv

fail() { echo "tests/peers: $*" >&2; exit 1; }

system=$(command -v python3) || fail "python3 is missing: install Python 3.11 or newer"
"$system" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || fail "$("$system" --version) is too old: 3.11 or newer is needed"

# The environment is made once, and again when the pinned versions change.
if ! cmp -s "$here/requirements.txt" "$venv/requirements.txt"; then
    rm -rf "$venv"
    mkdir -p "$(dirname "$venv")"
    "$system" -m venv "$venv" || fail "python3 can't make an environment: install its venv module (python3-venv)"
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --requirement "$here/requirements.txt" ||
        fail "a pinned package can't be installed: see above and $here/requirements.txt"
    cp "$here/requirements.txt" "$venv/requirements.txt"
fi

case $profile in
    release) folder=release ;;
    dev) folder=debug ;;
    *) fail "PEERS_PROFILE = \"$profile\" is unknown: release or dev" ;;
esac
cargo build --locked --quiet --profile "$profile" --bins # all of them: physics is then built once for all scripts
check() { # SCRIPT ARGUMENT …
    "$venv/bin/python" -B "$here/$1" --work "$target/peers" "${@:2}"
}
imports() { check import_check.py --importer "$target/$folder/peer_import" "$@"; }
standing() { check standing.py --standing "$target/$folder/peer_standing" "$@"; }
compare() { check compare.py --evogait "$target/$folder/evogait" --rollouts "$target/$folder/peer_rollouts" "$@"; }

case ${1:-} in
    --import) imports "${@:2}" ;;
    --standing) standing "${@:2}" ;;
    --quick)
        status=0
        compare "$@" || status=1
        imports 200 || status=1
        standing 20 || status=1
        exit "$status"
        ;;
    *) compare "$@" ;;
esac
