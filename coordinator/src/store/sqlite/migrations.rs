//! Schema of the SQLite store, as a sequence of steps. Steps are never changed, only added.

/// Steps: step n upgrades a file from `user_version = FIRST + n - 1` to `FIRST + n`.
pub(super) const MIGRATIONS: [&str; 1] = ["
    CREATE TABLE meta (
        id INTEGER PRIMARY KEY CHECK (id = 1),
        epoch INTEGER NOT NULL,
        -- The secret of permits.
        key BLOB NOT NULL
    ) STRICT;
    INSERT INTO meta (id, epoch, key) VALUES (1, 0, randomblob(32));

    CREATE TABLE jobs (
        number INTEGER PRIMARY KEY,
        id TEXT NOT NULL UNIQUE,
        request_id TEXT NOT NULL UNIQUE,
        state INTEGER NOT NULL,
        record BLOB NOT NULL,
        -- The state of its procedure before the round at hand; NULL once it has ended.
        run BLOB
    ) STRICT;
    CREATE INDEX jobs_by_state ON jobs (state, number);

    CREATE TABLE texts (
        job TEXT PRIMARY KEY,
        toml TEXT NOT NULL
    ) STRICT, WITHOUT ROWID;

    -- Of rounds at hand.
    CREATE TABLE results (
        job TEXT NOT NULL,
        round INTEGER NOT NULL,
        first INTEGER NOT NULL,
        results BLOB NOT NULL,
        PRIMARY KEY (job, round, first)
    ) STRICT, WITHOUT ROWID;

    -- Sealed rounds. Results are empty where they are not kept.
    CREATE TABLE rounds (
        job TEXT NOT NULL,
        round INTEGER NOT NULL,
        told BLOB NOT NULL,
        digests BLOB NOT NULL,
        results BLOB NOT NULL,
        PRIMARY KEY (job, round)
    ) STRICT, WITHOUT ROWID;

    CREATE TABLE events (
        job TEXT NOT NULL,
        sequence INTEGER NOT NULL,
        event BLOB NOT NULL,
        PRIMARY KEY (job, sequence)
    ) STRICT;

    -- Workers whose results are ignored.
    CREATE TABLE quarantined (
        worker TEXT PRIMARY KEY,
        entry BLOB NOT NULL
    ) STRICT, WITHOUT ROWID;

    CREATE TABLE artefacts (
        job TEXT NOT NULL,
        place INTEGER NOT NULL,
        name TEXT NOT NULL,
        media_type TEXT NOT NULL,
        content BLOB NOT NULL,
        PRIMARY KEY (job, place)
    ) STRICT;
"];

/// Version after the first step. Files of versions 1 to 3 are refused: they hold generations of genotypes, without the
/// rounds, tasks and digests of later versions.
pub(super) const FIRST: usize = 4;

/// SQLite application id of an evogait store: "evog" as a number.
pub(super) const APPLICATION_ID: i32 = 0x6576_6f67;
