//! Test suite that runs on every store.

mod files;
pub(crate) mod places;

use super::*;
use crate::record::{Charge, Claim, Dispute, Event, Origin, Poisoned, Ruling, Source};
use places::{Database, File, Reopen};
use sim_core::base::digest::Digest;
use sim_core::procedure::{Progress, Value};

/// Bits that careless storage changes: -0, NaN with a payload, infinity, the smallest number.
const ODD: [u64; 5] = [0x8000_0000_0000_0000, 0x7ff8_0000_dead_beef, 0xfff0_0000_0000_0000, 1, 0];

fn values() -> Vec<Value> {
    let value = |bits| Value { name: "best".into(), unit: "%".into(), value: Some(f64::from_bits(bits)) };
    let none = Value { name: "worst".into(), unit: "".into(), value: None };
    ODD.into_iter().map(value).chain([none]).collect()
}

pub(crate) fn record(number: u64) -> JobRecord {
    let digest = Digest::of("test", &number);
    JobRecord {
        name: format!("job {number}"),
        request_id: format!("request {number}"),
        request_digest: Digest([1; 32]),
        engine_digest: Digest([2; 32]),
        version: "0.9.9".to_owned(),
        procedure: "evolve".to_owned(),
        priority: 10,
        progress: Progress {
            phase: "searching".into(),
            unit: "generations".into(),
            done: 1,
            total: 2,
            values: values(),
        },
        last_event: 1,
        ..JobRecord::new(number, digest, 1_000)
    }
}

pub(crate) fn event(sequence: u64, state: JobState) -> JobEvent {
    JobEvent { sequence, at_ms: 5, event: Event::State(state) }
}

fn state(procedure: &[u8]) -> RunState {
    let task = TaskRecord { task: vec![0, 255], what: "a task".to_owned(), digest: Digest([9; 32]), finder: finder() };
    let last = LastRound { number: 0, tasks: [task.clone(), task].into() };
    RunState { procedure: procedure.to_vec(), last: Some(last) }
}

pub(crate) fn submit(record: &JobRecord) -> Write {
    Write::Submit {
        record: record.clone(),
        toml: "name = \"x\"".into(),
        state: RunState { procedure: vec![1, 2, 3], last: None },
        event: event(1, JobState::Queued),
    }
}

fn result(of: u64) -> Arc<[u8]> {
    of.to_le_bytes().into()
}

fn finder() -> Claimant {
    Claimant { worker: "w".into(), host: "h".into() }
}

fn stored_range(round: u32, first: u32, results: Vec<Arc<[u8]>>) -> StoredRange {
    StoredRange { round, first, results, finder: finder() }
}

fn results(record: &JobRecord, round: u32, ranges: Vec<(u32, Vec<Arc<[u8]>>)>) -> Write {
    Write::Results { job: record.id.clone(), round, ranges, finder: finder() }
}

fn sealed(number: u32) -> SealedRound {
    SealedRound {
        number,
        row: Some(SeriesRow { series: "generations".into(), index: number, values: values() }),
        digests: ODD.map(|bits| Digest::of("test", &bits)).to_vec(),
        results: number.is_multiple_of(2).then(|| ODD.map(result).to_vec()),
    }
}

/// Seals round `rounds_sealed - 1` of the record. A round with an even number keeps its results.
fn seal(record: &JobRecord, sequence: u64) -> Write {
    Write::Seal {
        record: record.clone(),
        sealed: sealed(record.rounds_sealed - 1),
        state: state(&[4, 5]),
        events: vec![event(sequence, JobState::Running), event(sequence + 1, JobState::Waiting)],
    }
}

fn end(record: &JobRecord, state: JobState) -> Write {
    let record = JobRecord { state, last_event: record.last_event + 1, ..record.clone() };
    Write::Change { event: event(record.last_event, state), record }
}

fn finish(record: &JobRecord, artefacts: Vec<Artefact>) -> Write {
    let (record, events) = (record.clone(), vec![event(record.last_event, record.state)]);
    Write::Finish { sealed: sealed(record.rounds_sealed - 1), record, artefacts, events }
}

fn artefact(name: &str, content: &[u8]) -> Artefact {
    Artefact { name: name.to_owned(), media_type: "application/json".to_owned(), content: content.to_vec() }
}

/// Generates the same tests for each store.
macro_rules! on_every_store {
    ($($(#[$doc:meta])* async fn $name:ident($store:ident) $body:block)*) => {
        mod memory {
            use super::*;
            $($(#[$doc])* #[tokio::test] async fn $name() { let $store = MemoryStore::default(); $body })*
        }
        mod sqlite {
            use super::*;
            $($(#[$doc])* #[tokio::test] async fn $name() { let $store = File::new().await; $body })*
        }
        mod postgres {
            use super::*;
            $($(#[$doc])* #[tokio::test] #[ignore = "needs PostgreSQL: tests/postgres.sh"]
            async fn $name() { let $store = Database::new().await; $body })*
        }
    };
}

on_every_store! {
    async fn committed_data_survives_restart_with_all_bits(store) {
        let loaded = store.start().await.unwrap();
        let (epoch, key) = (loaded.epoch, loaded.key);
        let job = record(1);
        let ranges = vec![(0, ODD.map(result).to_vec()), (9, vec![Arc::from([]), result(7)])];
        store.commit(epoch, vec![submit(&job), results(&job, 0, ranges.clone())]).await.unwrap();

        let store = store.reopen().await;
        let loaded = store.start().await.unwrap();
        assert_eq!((loaded.epoch, loaded.next_job, loaded.ended.len()), (epoch + 1, 2, 0));
        assert!(loaded.key.is_the_same_as(&key), "permits must stay valid");
        let [stored] = loaded.active.as_slice() else { panic!("one job") };
        assert_eq!(stored.record, job);
        assert_eq!((&*stored.toml, &stored.state), ("name = \"x\"", &RunState { procedure: vec![1, 2, 3], last: None }));
        let expected: Vec<_> = ranges.into_iter().map(|(first, results)| stored_range(0, first, results)).collect();
        assert_eq!(stored.results, expected);
    }

    async fn sealing_replaces_results_and_state_at_once(store) {
        let epoch = store.start().await.unwrap().epoch;
        let job = record(1);
        let after = JobRecord {
            rounds_sealed: 1,
            rounds_kept: 1,
            last_event: 3,
            state: JobState::Running,
            result_digest: Some(Digest([7; 32])),
            ..job.clone()
        };
        store.commit(epoch, vec![submit(&job), results(&job, 0, vec![(0, vec![result(1)])])]).await.unwrap();
        store.commit(epoch, vec![seal(&after, 2)]).await.unwrap();
        let more = JobRecord { rounds_sealed: 2, last_event: 5, ..after.clone() };
        store.commit(epoch, vec![seal(&more, 4)]).await.unwrap();

        let store = store.reopen().await;
        let loaded = store.start().await.unwrap();
        let stored = &loaded.active[0];
        assert_eq!((&stored.record, &stored.state, stored.results.len()), (&more, &state(&[4, 5]), 0));
        assert_eq!(store.digests(&job.id, 1).await.unwrap(), Some(sealed(1).digests));
        assert_eq!(store.digests(&job.id, 2).await.unwrap(), None);
        assert_eq!(store.rounds(&job.id, 0, 9).await.unwrap(), [sealed(0), sealed(1)]);
        assert_eq!(store.rounds(&job.id, 0, 1).await.unwrap(), [sealed(0)]);
        assert_eq!(store.rounds(&job.id, 1, 9).await.unwrap(), [sealed(1)]);
        let sequence = |events: Vec<StoredEvent>| events.iter().map(|e| e.event.sequence).collect::<Vec<_>>();
        assert_eq!(sequence(store.events(&job.id, 0, 10).await.unwrap()), [1, 2, 3, 4, 5]);
        assert_eq!(sequence(store.events(&job.id, 1, 1).await.unwrap()), [2]);
        let history = store.result(&job.id).await.unwrap().history;
        assert_eq!(history, [0, 1].map(|n| sealed(n).row.expect("the round has a row")));
    }

    async fn offered_batch_replaces_the_state(store) {
        let epoch = store.start().await.unwrap().epoch;
        let job = JobRecord { last_event: 2, ..record(1) };
        let offer = Write::Offer { record: job.clone(), state: state(&[8]), event: event(2, JobState::Running) };
        store.commit(epoch, vec![submit(&record(1)), offer]).await.unwrap();
        let store = store.reopen().await;
        let stored = store.start().await.unwrap().active.remove(0);
        assert_eq!((stored.record, stored.state), (job, state(&[8])));
    }

    async fn event_is_stored_with_its_job_record(store) {
        let epoch = store.start().await.unwrap().epoch;
        let job = record(1);
        let later = JobRecord { paused: true, last_event: 2, ..job.clone() };
        let paused = JobEvent { sequence: 2, at_ms: 6, event: Event::Paused(true) };
        store.commit(epoch, vec![submit(&job), Write::Change { record: later.clone(), event: paused.clone() }]).await.unwrap();
        let store = store.reopen().await;
        let events = store.events(&job.id, 1, 10).await.unwrap();
        let [stored] = events.as_slice() else { panic!("one event: {events:?}") };
        assert_eq!(stored, &StoredEvent { event: paused, job: later });
    }

    async fn note_survives_restart_without_an_event(store) {
        let epoch = store.start().await.unwrap().epoch;
        let job = record(1);
        let claim = |worker: &str, bits: u64| Claim {
            source: Source { finder: Claimant { worker: worker.into(), host: "h".into() }, name: "n".into() },
            digest: Digest::of("test", &bits),
            what: format!("score {bits}"),
            result: (worker != "a").then(|| bits.to_le_bytes().to_vec()),
            distrusted: worker == "b",
        };
        let dispute = Dispute {
            round: 0,
            index: 3,
            what: "the evaluation of candidate 3 of generation 0".to_owned(),
            task: vec![0, 1, 255],
            claims: vec![claim("a", ODD[0]), claim("b", ODD[4]), claim("c", ODD[1])],
            ruling: None,
            at_ms: 77,
        };
        let decided = Dispute { claims: vec![claim("", 3)], ruling: Some(Ruling::Tainted), ..dispute.clone() };
        let noted = JobRecord {
            paused: true,
            restarted_from: Some(Origin { job: "j0-x".into(), rounds: 4 }),
            disputes: vec![dispute, decided],
            charges: vec![
                Charge { first: 0, count: 1, attempt: true, lost: Some("w".into()) },
                Charge { first: 3, count: 5, attempt: false, lost: None },
            ],
            poisoned: Some(Poisoned { round: 1, index: 2, what: "it".to_owned(), task: vec![128, 0], attempts: 3 }),
            ..job.clone()
        };
        store.commit(epoch, vec![submit(&job), Write::Note { record: noted.clone() }]).await.unwrap();

        let store = store.reopen().await;
        assert_eq!(store.start().await.unwrap().active[0].record, noted);
        assert_eq!(store.job(&job.id).await.unwrap().unwrap().0, noted);
        assert_eq!(store.events(&job.id, 0, 10).await.unwrap().len(), 1);
    }

    async fn last_change_of_commit_stays_in_record(store) {
        let epoch = store.start().await.unwrap().epoch;
        let (job, other) = (record(1), record(2));
        let step = |n: u64| {
            let record = JobRecord { last_event: n, paused: n.is_multiple_of(2), ..job.clone() };
            Write::Change { record, event: event(n, JobState::Running) }
        };
        let note = Write::Note { record: JobRecord { last_event: 1, paused: true, ..job.clone() } };
        let writes = vec![submit(&job), submit(&other), note, step(2), step(3), Write::Note { record: other.clone() }, step(4)];
        store.commit(epoch, writes).await.unwrap();
        let store = store.reopen().await;
        let expected = JobRecord { last_event: 4, paused: true, ..job.clone() };
        assert_eq!(store.job(&job.id).await.unwrap().unwrap().0, expected);
        assert_eq!(store.events(&job.id, 0, 10).await.unwrap().len(), 4);

        // The end of the job removes its state and results.
        let epoch = store.start().await.unwrap().epoch;
        let last = JobRecord { state: JobState::Cancelled, last_event: 5, ..job.clone() };
        let cancel = Write::Change { record: last.clone(), event: event(5, JobState::Cancelled) };
        store.commit(epoch, vec![cancel, Write::Note { record: last.clone() }]).await.unwrap();
        let store = store.reopen().await;
        let loaded = store.start().await.unwrap();
        assert_eq!(loaded.ended, std::slice::from_ref(&job.id));
        assert_eq!(loaded.active.len(), 1);
    }

    async fn restart_takes_over_earlier_rounds_only(store) {
        let epoch = store.start().await.unwrap().epoch;
        let (old, new) = (record(1), record(2));
        let at = |n| JobRecord { rounds_sealed: n, last_event: 2 * u64::from(n) + 1, ..old.clone() };
        let writes = vec![submit(&old), seal(&at(1), 2), seal(&at(2), 4), end(&at(2), JobState::Tainted)];
        store.commit(epoch, writes).await.unwrap();
        let carry = Write::Carry { from: old.id.clone(), to: new.id.clone(), rounds: 1 };
        store.commit(epoch, vec![submit(&JobRecord { rounds_sealed: 1, ..new.clone() }), carry]).await.unwrap();

        let store = store.reopen().await;
        let loaded = store.start().await.unwrap();
        assert_eq!(loaded.ended, std::slice::from_ref(&old.id));
        assert_eq!(loaded.active.len(), 1);
        assert_eq!(store.rounds(&new.id, 0, 9).await.unwrap(), [sealed(0)]);
        assert_eq!(store.digests(&new.id, 0).await.unwrap(), Some(sealed(0).digests));
        assert_eq!(store.rounds(&old.id, 0, 9).await.unwrap().len(), 2, "the old job keeps its rounds");
    }

    async fn quarantine_survives_and_the_first_reason_stays(store) {
        let epoch = store.start().await.unwrap().epoch;
        let entry = |worker: &str, reason: &str| Quarantined {
            worker: worker.into(),
            name: "n".into(),
            host: "h".into(),
            credential: "c0ffee".into(),
            reason: reason.to_owned(),
            at_ms: 5,
        };
        let add = |worker: &str, reason: &str| Write::Quarantine { entry: entry(worker, reason), instead_of: None };
        store.commit(epoch, ["a", "b", "a"].map(|w| add(w, "why")).to_vec()).await.unwrap();
        store.commit(epoch, vec![add("a", "again")]).await.unwrap();
        let store = store.reopen().await;
        let loaded = store.start().await.unwrap();
        assert_eq!(loaded.quarantined, [entry("a", "why"), entry("b", "why")]);
        let instead = Write::Quarantine { entry: entry("c", "why"), instead_of: Some("a".into()) };
        store.commit(loaded.epoch, vec![instead]).await.unwrap();
        assert_eq!(store.start().await.unwrap().quarantined, [entry("b", "why"), entry("c", "why")]);
    }

    async fn writes_of_an_earlier_epoch_change_nothing(store) {
        let old = store.start().await.unwrap().epoch;
        let job = record(1);
        let range = |first| results(&job, 0, vec![(first, vec![result(1)])]);
        store.commit(old, vec![submit(&job), range(0)]).await.unwrap();
        let before = store.start().await.unwrap();
        let done = JobRecord { state: JobState::Succeeded, rounds_sealed: 1, last_event: 3, ..job.clone() };
        let finish = finish(&done, vec![artefact("report", b"1")]);
        let late = [submit(&record(2)), range(1), seal(&done, 2), end(&job, JobState::Cancelled), finish];
        for write in late.into_iter().map(|w| vec![w]).chain([vec![range(2), end(&job, JobState::Failed)], vec![]]) {
            let refused = store.commit(old, write).await;
            let superseded = matches!(refused, Err(StoreError::Superseded { own, by }) if (own, by) == (old, before.epoch));
            assert!(superseded, "{refused:?}");
        }
        assert_eq!(store.events(&job.id, 0, 10).await.unwrap().len(), 1);
        assert_eq!(store.result(&job.id).await.unwrap(), StoredResult::default());
        assert_eq!(store.jobs(u64::MAX, 10, &[]).await.unwrap(), std::slice::from_ref(&job));
        store.commit(before.epoch, vec![range(1)]).await.unwrap();
        let after = store.start().await.unwrap();
        assert_eq!(after.active[0].results, [0, 1].map(|first| stored_range(0, first, vec![result(1)])));
        assert_eq!(after.active[0].record, before.active[0].record);
    }

    async fn failed_commit_changes_nothing(store) {
        let epoch = store.start().await.unwrap().epoch;
        // The second job has the request id of the first.
        let twin = JobRecord { number: 2, id: JobId::new(2, &Digest([5; 32])), ..record(1) };
        assert!(store.commit(epoch, vec![submit(&record(1)), submit(&twin)]).await.is_err());
        assert!(store.jobs(u64::MAX, 10, &[]).await.unwrap().is_empty());
        store.commit(epoch, vec![submit(&record(1))]).await.unwrap();
        assert!(store.commit(epoch, vec![submit(&twin)]).await.is_err(), "the request id is in use");
        assert_eq!(store.jobs(u64::MAX, 10, &[]).await.unwrap(), [record(1)]);
        store.commit(epoch, vec![submit(&record(2))]).await.unwrap();
    }

    async fn large_round_survives_restart_with_all_bits(store) {
        let epoch = store.start().await.unwrap().epoch;
        let job = record(1);
        // Arbitrary bytes, in ranges with gaps between them.
        let bits = |i: u32| u64::from(i).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let range = |first: u32| (first, (first..first + 9).map(|i| result(bits(i))).collect::<Vec<_>>());
        let ranges: Vec<_> = (0..10_000).step_by(10).map(range).collect();
        store.commit(epoch, vec![submit(&job), results(&job, 0, ranges.clone())]).await.unwrap();
        let store = store.reopen().await;
        let loaded = store.start().await.unwrap();
        let expected: Vec<_> = ranges.into_iter().map(|(first, results)| stored_range(0, first, results)).collect();
        assert!(loaded.active[0].results == expected);

        let all: Vec<_> = (0..10_000).map(|i| result(bits(i))).collect();
        let digests = (0..10_000).map(|i| Digest::of("test", &bits(i))).collect();
        let round = SealedRound { number: 0, row: None, digests, results: Some(all) };
        let after = JobRecord { rounds_sealed: 1, last_event: 2, ..job.clone() };
        let large = RunState { procedure: vec![9; 3_000_000], last: None };
        let (state, events) = (large.clone(), vec![event(2, JobState::Running)]);
        store.commit(loaded.epoch, vec![Write::Seal { record: after, sealed: round.clone(), state, events }]).await.unwrap();
        let store = store.reopen().await;
        let stored = store.start().await.unwrap().active.remove(0);
        assert!(stored.state == large && stored.results.is_empty());
        assert!(store.rounds(&job.id, 0, 1).await.unwrap() == [round]);
    }

    async fn names_keep_every_character(store) {
        let epoch = store.start().await.unwrap().epoch;
        // The last two look the same, but differ.
        let names = ["机器人 🦎", "'; DROP TABLE jobs; --", "a\\b\"c\nd\te %s $1 ?", "\u{202e}gnal", "\u{e9}", "e\u{301}"];
        let named = |(i, name): (usize, &&str)| {
            JobRecord { name: name.to_string(), request_id: name.to_string(), ..record(i as u64 + 1) }
        };
        let jobs: Vec<_> = names.iter().enumerate().map(named).collect();
        let submit_named = |job: &JobRecord| match submit(job) {
            Write::Submit { record, state, event, .. } => {
                Write::Submit { toml: record.name.as_str().into(), record, state, event }
            }
            other => other,
        };
        store.commit(epoch, jobs.iter().map(submit_named).collect()).await.unwrap();
        let store = store.reopen().await;
        for job in &jobs {
            assert_eq!(store.job_of_request(&job.request_id).await.unwrap().as_ref(), Some(job));
            assert_eq!(store.job(&job.id).await.unwrap(), Some((job.clone(), job.name.clone())));
        }
        assert!(store.job_of_request("\u{c9}").await.unwrap().is_none(), "request ids are case-sensitive");
    }

    async fn calls_after_closing_are_refused(store) {
        let epoch = store.start().await.unwrap().epoch;
        store.commit(epoch, vec![submit(&record(1))]).await.unwrap();
        store.release(epoch).await.unwrap();
        store.close().await.unwrap();
        store.close().await.unwrap();
        for late in [store.commit(epoch, vec![]).await.err(), store.job(&record(1).id).await.err()] {
            assert!(matches!(late, Some(StoreError::Closed)), "{late:?}");
        }
    }

    async fn jobs_are_found_by_id_request_and_page(store) {
        let epoch = store.start().await.unwrap().epoch;
        let jobs: Vec<_> = (1..=5).map(record).collect();
        store.commit(epoch, jobs.iter().map(submit).collect()).await.unwrap();
        store.commit(epoch, vec![end(&jobs[1], JobState::Cancelled), end(&jobs[3], JobState::Failed)]).await.unwrap();

        let numbers = |records: Vec<JobRecord>| records.iter().map(|r| r.number).collect::<Vec<_>>();
        assert_eq!(numbers(store.jobs(u64::MAX, 2, &[]).await.unwrap()), [5, 4]);
        assert_eq!(numbers(store.jobs(4, 2, &[]).await.unwrap()), [3, 2]);
        let ended = [JobState::Cancelled, JobState::Failed];
        assert_eq!(numbers(store.jobs(u64::MAX, 10, &ended).await.unwrap()), [4, 2]);
        assert_eq!(store.job(&jobs[0].id).await.unwrap().unwrap().0, jobs[0]);
        assert!(store.job(&"j1-none".into()).await.unwrap().is_none());
        assert_eq!(store.job_of_request("request 3").await.unwrap().unwrap().number, 3);
        assert!(store.job_of_request("request 9").await.unwrap().is_none());

        let loaded = store.start().await.unwrap();
        assert_eq!(loaded.next_job, 6);
        assert_eq!(loaded.active.iter().map(|j| j.record.number).collect::<Vec<_>>(), [1, 3, 5]);
        assert_eq!(loaded.ended, [jobs[1].id.clone(), jobs[3].id.clone()]);
    }

    async fn ended_job_keeps_artefacts_and_loses_state(store) {
        let epoch = store.start().await.unwrap().epoch;
        let job = record(1);
        let done = JobRecord { state: JobState::Succeeded, rounds_sealed: 1, last_event: 2, ..job.clone() };
        let artefacts = vec![artefact("report", b"{\"winner\":1}"), artefact("a", &[0, 255])];
        let range = results(&job, 0, vec![(0, vec![result(1)])]);
        store.commit(epoch, vec![submit(&job), range, finish(&done, artefacts.clone())]).await.unwrap();
        let store = store.reopen().await;
        let history = vec![sealed(0).row.expect("the round has a row")];
        assert_eq!(store.result(&job.id).await.unwrap(), StoredResult { history, artefacts });
        assert_eq!(store.job(&job.id).await.unwrap().unwrap().0, done);
        assert!(store.start().await.unwrap().active.is_empty());
    }
}
