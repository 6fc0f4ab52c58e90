//! The PostgreSQL store's schema, step by step. Steps are never changed, only added.
//!
//! Everything is in a schema of its own, so that a database can be shared with other programs.

/// Step n brings a schema of version n to n + 1.
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
        released BOOLEAN NOT NULL
    );
    INSERT INTO coordinator VALUES (1, 0, 0, 'epoch', 0, TRUE);

    CREATE TABLE jobs (
        number BIGINT PRIMARY KEY,
        id TEXT NOT NULL UNIQUE,
        request_id TEXT NOT NULL UNIQUE,
        state BIGINT NOT NULL,
        record BYTEA NOT NULL,
        search BYTEA
    );
    CREATE INDEX jobs_by_state ON jobs (state, number);

    CREATE TABLE texts (
        job TEXT PRIMARY KEY,
        toml TEXT NOT NULL
    );

    CREATE TABLE results (
        job TEXT NOT NULL,
        round BIGINT NOT NULL,
        first BIGINT NOT NULL,
        outcomes BYTEA NOT NULL,
        PRIMARY KEY (job, round, first)
    );

    CREATE TABLE generations (
        job TEXT NOT NULL,
        generation BIGINT NOT NULL,
        statistics BYTEA NOT NULL,
        scores BYTEA NOT NULL,
        PRIMARY KEY (job, generation)
    );

    CREATE TABLE events (
        job TEXT NOT NULL,
        sequence BIGINT NOT NULL,
        event BYTEA NOT NULL,
        PRIMARY KEY (job, sequence)
    );

    -- Workers whose results are not trusted any more.
    CREATE TABLE quarantined (
        worker TEXT PRIMARY KEY,
        entry BYTEA NOT NULL
    );

    CREATE TABLE reports (
        job TEXT PRIMARY KEY,
        report BYTEA NOT NULL
    );
"];
