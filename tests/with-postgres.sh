#!/usr/bin/env bash
# Runs a command with a PostgreSQL server of its own, from Debian's packages: in a temporary folder, reachable through a
# socket there and by TLS on loopback only. The server ends with the command, and the exit code is the command's.
#
#   tests/with-postgres.sh COMMAND [ARGUMENT…]      from the top of the tree; EVOGAIT_TEST_POSTGRES* say where the server is
set -euo pipefail
cd "$(dirname "$0")/.."

fail() { echo "tests/with-postgres.sh: $*" >&2; exit 1; }
[ $# -gt 0 ] || fail "which command?"

find_server() { ls -d /usr/lib/postgresql/*/bin 2>/dev/null | sort -V | tail -1; }
bin=$(find_server)
if [ -z "$bin" ]; then
    [ "$(id -u)" = 0 ] || fail "there is no PostgreSQL: apt-get install postgresql"
    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq postgresql >/dev/null || fail "PostgreSQL can't be installed"
    bin=$(find_server)
fi
for program in initdb postgres pg_isready; do
    [ -x "$bin/$program" ] || fail "$bin/$program is missing: apt-get install postgresql"
done

# PostgreSQL does not run as root.
as_server=()
if [ "$(id -u)" = 0 ]; then
    id postgres >/dev/null 2>&1 || fail "there is no user postgres: apt-get install postgresql"
    command -v setpriv >/dev/null || fail "setpriv is missing: apt-get install util-linux"
    as_server=(setpriv --reuid=postgres --regid=postgres --clear-groups)
fi

# The whole workspace, as `cargo test` builds it: with fewer packages, physics would be built again with fewer features.
cargo build --locked --quiet --workspace --bins --tests
evogait=$(realpath "${CARGO_TARGET_DIR:-target}/debug/evogait")
[ -x "$evogait" ] || fail "there is no $evogait"

folder=$(mktemp -d)
server=
end() {
    if [ -n "$server" ]; then
        kill -INT "$server" 2>/dev/null || true
        wait "$server" 2>/dev/null || true
    fi
    rm -rf "$folder"
}
trap end EXIT
chmod 755 "$folder"
mkdir "$folder/data" "$folder/socket" "$folder/tls"
"$evogait" certs init "$folder/certs" --host localhost >/dev/null
"$evogait" certs init "$folder/other" --host localhost >/dev/null
cp "$folder/certs/coordinator.pem" "$folder/certs/coordinator.key" "$folder/tls"
[ ${#as_server[@]} = 0 ] || chown -R postgres "$folder/data" "$folder/socket" "$folder/tls"
cd "$folder"
"${as_server[@]}" "$bin/initdb" --pgdata="$folder/data" --auth=trust --username=evogait --encoding=UTF8 --no-instructions \
    >"$folder/initdb.log" 2>&1 || { cat "$folder/initdb.log" >&2; fail "initdb failed"; }
printf '%s\n' "local all all trust" "hostssl all all 127.0.0.0/8 trust" >"$folder/data/pg_hba.conf"
cd - >/dev/null

# Which ports are free can't be known: it tries some.
answers() { "$bin/pg_isready" --quiet --host="$folder/socket" --port="$port"; }
start() {
    port=$((20000 + RANDOM % 10000))
    "${as_server[@]}" "$bin/postgres" -D "$folder/data" -c listen_addresses=127.0.0.1,127.0.0.2 -c port="$port" \
        -c unix_socket_directories="$folder/socket" -c max_connections=200 -c ssl=on \
        -c ssl_cert_file="$folder/tls/coordinator.pem" -c ssl_key_file="$folder/tls/coordinator.key" \
        >"$folder/server.log" 2>&1 &
    server=$!
    for _ in $(seq 100); do
        answers && return
        kill -0 "$server" 2>/dev/null || break
        sleep 0.1
    done
    answers
}
start || start || start || { cat "$folder/server.log" >&2; fail "the server does not start"; }

# The tests replace DATABASE by the names of databases they make.
export EVOGAIT_TEST_POSTGRES="postgres://evogait@${folder//\//%2F}%2Fsocket:$port/DATABASE"
# The same server by TLS: its certificate is for localhost, signed by the one CA and not by the other.
export EVOGAIT_TEST_POSTGRES_TLS="postgres://evogait@localhost:$port/DATABASE"
export EVOGAIT_TEST_POSTGRES_CA="$folder/certs/ca.pem" EVOGAIT_TEST_POSTGRES_OTHER_CA="$folder/other/ca.pem"
# The server's own programs, such as postgres --version, after what else is found.
export PATH="$PATH:$bin"

"$@"
