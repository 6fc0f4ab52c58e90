//! Schema of the PostgreSQL store, as a sequence of steps. Steps are never changed, only added.
//!
//! All tables are in their own schema, so that other programs can share the database.

/// Steps: step n upgrades the schema from version FIRST + n - 1 to FIRST + n.
pub(super) const MIGRATIONS: [&str; 1] = ["
    -- One row: who is at work. Every commit goes through it, which is what keeps an old coordinator out.
    CREATE TABLE coordinator (
        id BIGINT PRIMARY KEY CHECK (id = 1),
        -- Counts the starts.
        epoch BIGINT NOT NULL,
        -- Counts the commits of this epoch, so that one whose answer was lost is not done twice.
        commits BIGINT NOT NULL,
        -- By the database's clock.
        renewed_at TIMESTAMPTZ NOT NULL,
        -- Without a renewal for this long it is taken for dead.
        takeover_ms BIGINT NOT NULL,
        -- It stopped in an orderly way.
        released BOOLEAN NOT NULL,
        -- The secret of permits.
        key BYTEA NOT NULL
    );
    INSERT INTO coordinator 
        VALUES (1, 0, 0, 'epoch', 0, TRUE, uuid_send(gen_random_uuid()) || uuid_send(gen_random_uuid()));

    CREATE TABLE jobs (
        number BIGINT PRIMARY KEY,
        id TEXT NOT NULL UNIQUE,
        request_id TEXT NOT NULL UNIQUE,
        state BIGINT NOT NULL,
        record BYTEA NOT NULL,
        -- The state of its procedure before the round at hand; NULL once it has ended.
        run BYTEA
    );
    CREATE INDEX jobs_by_state ON jobs (state, number);

    CREATE TABLE texts (
        job TEXT PRIMARY KEY,
        toml TEXT NOT NULL
    );

    -- Of rounds at hand.
    CREATE TABLE results (
        job TEXT NOT NULL,
        round BIGINT NOT NULL,
        first BIGINT NOT NULL,
        results BYTEA NOT NULL,
        PRIMARY KEY (job, round, first)
    );

    -- Sealed rounds. Results are empty where they are not kept.
    CREATE TABLE rounds (
        job TEXT NOT NULL,
        round BIGINT NOT NULL,
        told BYTEA NOT NULL,
        digests BYTEA NOT NULL,
        results BYTEA NOT NULL,
        PRIMARY KEY (job, round)
    );

    CREATE TABLE events (
        job TEXT NOT NULL,
        sequence BIGINT NOT NULL,
        event BYTEA NOT NULL,
        PRIMARY KEY (job, sequence)
    );

    -- Workers whose results are ignored.
    CREATE TABLE quarantined (
        worker TEXT PRIMARY KEY,
        entry BYTEA NOT NULL
    );

    CREATE TABLE artefacts (
        job TEXT NOT NULL,
        place BIGINT NOT NULL,
        name TEXT NOT NULL,
        media_type TEXT NOT NULL,
        content BYTEA NOT NULL,
        PRIMARY KEY (job, place)
    );
"];

/// Version after the first step. Schemas of version 1 are refused: they hold generations of genotypes, without the
/// rounds, tasks and digests of later versions.
pub(super) const FIRST: usize = 2;
