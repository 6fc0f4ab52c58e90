# Sourced by tests that follow docs/deploy.md to the letter.

# Prints the block of code under the line `<!-- $1 -->` of the page.
page() {
    local block
    block=$(awk -v mark="<!-- $1 -->" '$0 == mark { found = 1; next } found && /^```/ { if (open) exit; open = 1; next } open' docs/deploy.md)
    [ -n "$block" ] || { echo "docs/deploy.md has no block \"$1\"" >&2; exit 1; }
    printf '%s\n' "$block"
}

# A test that needs a port or a path of its own for the page's redefines this.
adapt() { cat; }

# Runs a block as a person would paste it; stops at the first command that fails.
follow() {
    echo "-- docs/deploy.md, \"$1\""
    page "$1" | adapt > "$work/$1.sh"
    # shellcheck disable=SC1090
    . "$work/$1.sh"
}

# `docker compose` where there is only docker-compose 1.29.
if ! docker compose version > /dev/null 2>&1 && command -v docker-compose > /dev/null; then
    docker() {
        if [ "${1-}" = compose ]; then shift; docker-compose "$@"; else command docker "$@"; fi
    }
fi
