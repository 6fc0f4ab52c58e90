//! The SQLite store's schema, step by step. Steps are never changed, only added.

/// Step n brings a file with `user_version = n` to `n + 1`.
pub(super) const MIGRATIONS: [&str; 3] = [
    "
    CREATE TABLE meta (
        id INTEGER PRIMARY KEY CHECK (id = 1),
        epoch INTEGER NOT NULL
    ) STRICT;
    INSERT INTO meta (id, epoch) VALUES (1, 0);

    CREATE TABLE jobs (
        number INTEGER PRIMARY KEY,
        id TEXT NOT NULL UNIQUE,
        request_id TEXT NOT NULL UNIQUE,
        state INTEGER NOT NULL,
        record BLOB NOT NULL,
        optimiser BLOB
    ) STRICT;
    CREATE INDEX jobs_by_state ON jobs (state, number);

    CREATE TABLE texts (
        job TEXT PRIMARY KEY,
        toml TEXT NOT NULL
    ) STRICT, WITHOUT ROWID;

    CREATE TABLE results (
        job TEXT NOT NULL,
        generation INTEGER NOT NULL,
        first INTEGER NOT NULL,
        outcomes BLOB NOT NULL,
        PRIMARY KEY (job, generation, first)
    ) STRICT, WITHOUT ROWID;

    CREATE TABLE generations (
        job TEXT NOT NULL,
        generation INTEGER NOT NULL,
        statistics BLOB NOT NULL,
        scores BLOB NOT NULL,
        PRIMARY KEY (job, generation)
    ) STRICT, WITHOUT ROWID;

    CREATE TABLE events (
        job TEXT NOT NULL,
        sequence INTEGER NOT NULL,
        event BLOB NOT NULL,
        PRIMARY KEY (job, sequence)
    ) STRICT, WITHOUT ROWID;

    CREATE TABLE reports (
        job TEXT PRIMARY KEY,
        report BLOB NOT NULL
    ) STRICT;
",
    // Rounds of examinations follow the search, and its state has an archive.
    "
    ALTER TABLE results RENAME COLUMN generation TO round;
    ALTER TABLE jobs RENAME COLUMN optimiser TO search;
",
    // Workers whose results are not trusted any more.
    "
    CREATE TABLE quarantined (
        worker TEXT PRIMARY KEY,
        entry BLOB NOT NULL
    ) STRICT, WITHOUT ROWID;
",
];

/// Files of earlier steps are refused: their jobs and reports have no finish, and there is nothing to make one from.
pub(super) const FIRST_READABLE: usize = 2;

/// Marks a file as an evogait store: "evog" as SQLite's application id.
pub(super) const APPLICATION_ID: i32 = 0x6576_6f67;
