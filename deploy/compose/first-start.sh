#!/bin/sh
# Makes the credentials of the parts of the compose cluster, at the first start: certificates, tokens, the database's
# password. Each part has a volume of its own with what it needs and nothing else. Run again, it changes nothing.
#
# HOSTS: names and addresses that clients may call the coordinator by, separated by spaces.
set -eu
umask 077
cd /etc/evogait

if [ ! -e authority/done ]; then
    rm -rf authority/certs
    names=
    for host in $HOSTS; do names="$names --host $host"; done
    # shellcheck disable=SC2086
    evogait certs init authority/certs $names
    head -c 24 /dev/urandom | od -An -tx1 | tr -d ' \n' > authority/database-password
    : > authority/done
fi

# give TO FILE…: through a temporary name, so that no part reads half a file.
give() {
    to=$1
    shift
    for file; do
        cp "authority/$file" "$to/.new"
        mv "$to/.new" "$to/${file##*/}"
    done
}
give coordinator certs/ca.pem certs/coordinator.pem certs/coordinator.key certs/tokens
give worker certs/ca.pem certs/worker.token
give client certs/ca.pem certs/client.token
give postgres database-password
# The database runs as another user; only its container has this volume.
chmod 444 postgres/database-password
chmod 755 postgres
printf '*:*:*:evogait:%s\n' "$(cat authority/database-password)" > coordinator/pgpass
