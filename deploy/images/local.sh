#!/usr/bin/env bash
# Makes on this machine what a registry would give: base images from Debian's packages, and the binaries of target/release
# as the Dockerfile takes them. For machines that reach no registry, and for CI.
#
#   deploy/images/local.sh runtime    evogait-local/debian: Debian, as small as it is installed (root; debootstrap)
#   deploy/images/local.sh rust       evogait-local/rust: that, with gcc and this machine's Rust toolchain
#   deploy/images/local.sh postgres   evogait-local/postgres: that, with Debian's PostgreSQL
#   deploy/images/local.sh prometheus evogait-local/prometheus: that, with Debian's Prometheus
#   deploy/images/local.sh binaries   target/image: coordinator, worker and evogait of target/release, or of the folder EVOGAIT_BINARIES
#
# An image that is there is kept; `docker rmi NAME` makes it anew. What compose.yaml needs to take them is in
# deploy/images/local.env.
set -euo pipefail
cd "$(dirname "$0")/../.."
suite=bookworm

need() { command -v "$1" > /dev/null || { echo "local.sh: $1 is needed: apt-get install $2" >&2; exit 1; }; }
there() { docker image inspect "$1" > /dev/null 2>&1; }

runtime() {
    there evogait-local/debian && return
    need debootstrap debootstrap
    local root
    root=$(mktemp -d)
    # shellcheck disable=SC2064
    trap "rm -rf --one-file-system '$root'" EXIT
    debootstrap --variant=minbase --include=ca-certificates "$suite" "$root" > "$root.log" || { tail -n 20 "$root.log" >&2; exit 1; }
    rm -rf "$root.log" "$root"/var/cache/apt/* "$root"/var/lib/apt/lists/* "$root"/usr/share/{doc,man,locale}/* "$root"/var/log/*
    tar -C "$root" -c . | docker import - evogait-local/debian > /dev/null
    rm -rf --one-file-system "$root"
    trap - EXIT
}

# With what this folder has under the name.
built() {
    there "evogait-local/$1" && return
    runtime
    docker build --build-arg BASE=evogait-local/debian -t "evogait-local/$1" -f "deploy/images/$1.Dockerfile" deploy/images
}

rust() {
    there evogait-local/rust && return
    runtime
    local context
    context=$(mktemp -d)
    # shellcheck disable=SC2064
    trap "rm -rf '$context'" EXIT
    cp -r "$(rustc --print sysroot)" "$context/toolchain"
    rm -rf "$context"/toolchain/share
    docker build --build-arg BASE=evogait-local/debian -t evogait-local/rust -f deploy/images/rust.Dockerfile "$context"
    rm -rf "$context"
    trap - EXIT
}

binaries() {
    need strip binutils
    mkdir -p target/image
    local name from=${EVOGAIT_BINARIES:-target/release}
    for name in coordinator worker evogait; do
        [ -x "$from/$name" ] || { echo "local.sh: $from/$name is not there: cargo build --release" >&2; exit 1; }
        strip -o "target/image/$name" "$from/$name"
    done
}

[ $# -gt 0 ] || { sed -n '2,/^set/p' "$0" | grep '^#' >&2; exit 2; }
for what; do
    case $what in
        runtime | rust | binaries) "$what" ;;
        postgres | prometheus) built "$what" ;;
        *) echo "local.sh: there is no \"$what\": runtime, rust, postgres, prometheus, binaries" >&2; exit 2 ;;
    esac
done
