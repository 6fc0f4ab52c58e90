#!/usr/bin/env bash
# Makes the archive of a release: the three programs, man pages, completions, licences, and the files of deploy/. Then it
# unpacks the archive and runs a program of it.
#
#   deploy/package.sh [FOLDER]      target/package unless given
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-target/package}
cargo build --locked --release --quiet --bins
bin=${CARGO_TARGET_DIR:-target}/release
version=$("$bin/evogait" --version | cut -d' ' -f2)
host=$(rustc -vV | sed -n 's/^host: //p')
name=evogait-$version-$host
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

mkdir -p "$work/$name"/{bin,man/man1,completions} "$folder"
for program in evogait coordinator worker; do
    strip -o "$work/$name/bin/$program" "$bin/$program"
done
"$bin/evogait" man --out "$work/$name/man/man1"
for shell in bash zsh fish elvish powershell; do
    "$bin/evogait" completions $shell > "$work/$name/completions/evogait.$shell"
done
cp LICENSE-MIT LICENSE-APACHE README.md CHANGELOG.md CITATION.cff "$work/$name"
git archive HEAD deploy | tar -x -C "$work/$name"
tar -czf "$folder/$name.tar.gz" -C "$work" "$name"
(cd "$folder" && sha256sum "$name.tar.gz" > "$name.tar.gz.sha256")

mkdir "$work/unpacked"
tar -xzf "$folder/$name.tar.gz" -C "$work/unpacked"
"$work/unpacked/$name/bin/evogait" scenarios > "$work/listed"
grep -q quadropod-empty "$work/listed"
echo "$folder/$name.tar.gz: $(stat -c %s "$folder/$name.tar.gz") bytes, $(find "$work/$name" -type f | wc -l) files"
