#!/usr/bin/env bash
# The manifests of deploy/kubernetes against the schemas that Kubernetes publishes, strictly; and that what they name is
# there: options of our programs, secrets of docs/deploy.md. Needs python3 with venv; where kubectl is, both kustomizations are
# built with it and checked whole, else their files are checked one by one.
#
#   tests/kubernetes.sh
set -euo pipefail
cd "$(dirname "$0")/.."
: "${EVOGAIT_BINARIES:=target/release}"
[ "$EVOGAIT_BINARIES" != target/release ] || cargo build --locked --release --quiet
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
# It carries the schemas.
"$work/venv/bin/pip" install --quiet --disable-pip-version-check kubernetes-validate==1.37.0
if command -v kubectl > /dev/null; then
    for name in base keda; do kubectl kustomize "deploy/kubernetes/$name" > "$work/$name.yaml"; done
    "$work/venv/bin/python" tests/manifests.py "$EVOGAIT_BINARIES" "$work"/*.yaml
else
    "$work/venv/bin/python" tests/manifests.py "$EVOGAIT_BINARIES" deploy/kubernetes/*/*.yaml
fi
