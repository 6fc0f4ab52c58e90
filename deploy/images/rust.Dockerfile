# Stands for rust:slim where no registry can be reached. The context is a toolchain's folder; see local.sh.
ARG BASE
FROM ${BASE}
RUN apt-get update && apt-get install -y --no-install-recommends gcc libc6-dev && rm -rf /var/lib/apt/lists/*
COPY toolchain /usr/local
