//! One suite, run on every store.

pub(crate) mod places;

use super::*;
use crate::record::{Charge, Claim, Dispute, Origin, Ruling, Source, Subject};
use crate::scheduler::Finder;
use places::{Database, File, Reopen, open_file};
use proto::v1::job_event::Event;
use sim_core::base::digest::{Digest, ResultDigest};
use sim_core::base::score::Counts;
use sim_core::procedure::evolve::finish::{Examination, Question};
use sim_core::search::Scored;
use std::path::Path;

/// Bits that do not survive careless storage: -0, NaN with a payload, infinity, the smallest number.
const ODD: [u64; 5] = [0x8000_0000_0000_0000, 0x7ff8_0000_dead_beef, 0xfff0_0000_0000_0000, 1, 0];

pub(crate) fn record(number: u64) -> JobRecord {
    let digest = Digest::of("test", &number);
    JobRecord {
        id: JobId::new(number, &digest),
        number,
        name: format!("job {number}"),
        request_id: format!("request {number}"),
        request_digest: Digest([1; 32]),
        state: JobState::Queued,
        job_digest: digest,
        engine_digest: Digest([2; 32]),
        version: "0.9.9".to_owned(),
        search_revision: 4,
        population: 4,
        generations_done: 0,
        generations_total: 2,
        priority: 10,
        best: None,
        first: None,
        winner: None,
        counts: Counts::default(),
        evaluations: 0,
        failed_evaluations: 0,
        reason: String::new(),
        paused: false,
        restarted_from: None,
        disputes: Vec::new(),
        charges: Vec::new(),
        poisoned: None,
        submitted_at_ms: 1_000,
        started_at_ms: 0,
        ended_at_ms: 0,
        last_event: 1,
        scores_digest: ResultDigest::start(&digest),
        result_digest: None,
    }
}

pub(crate) fn event(sequence: u64, state: JobState) -> v1::JobEvent {
    v1::JobEvent { sequence, at_ms: 5, event: Some(Event::StateChanged(state.into())), job: None }
}

pub(crate) fn submit(record: &JobRecord) -> Write {
    Write::Submit {
        record: record.clone(),
        toml: "name = \"x\"".into(),
        search: vec![1, 2, 3],
        event: event(1, JobState::Queued),
    }
}

fn outcome(bits: u64) -> Outcome {
    Outcome::evaluation(Some(f64::from_bits(bits)), Counts { rollouts: bits, ..Counts::default() })
}

fn failed() -> Outcome {
    Outcome::evaluation(None, Counts { unstable: 1, ..Counts::default() })
}

fn answer() -> Outcome {
    let scores = ODD.iter().map(|b| Some(f64::from_bits(*b))).chain([None]).collect();
    Outcome { scores, counts: Counts { nodes: 3, ..Counts::default() }, traces: b"{}".to_vec() }
}

fn finder() -> Finder {
    Finder { worker: "w".into(), host: "h".into() }
}

fn stored_range(round: u32, first: u32, outcomes: Vec<Outcome>) -> StoredRange {
    StoredRange { round, first, outcomes, finder: finder() }
}

fn seal(record: &JobRecord, sequence: u64) -> Write {
    let scores = ODD.iter().map(|b| Some(f64::from_bits(*b))).chain([None]).collect();
    let statistics = v1::GenerationSealed { generation: record.generations_done - 1, ..Default::default() };
    Write::Seal {
        record: record.clone(),
        sealed: SealedGeneration { scores, statistics },
        search: vec![4, 5],
        events: vec![event(sequence, JobState::Running), event(sequence + 1, JobState::Reporting)],
    }
}

fn end(record: &JobRecord, state: JobState) -> Write {
    let record = JobRecord { state, last_event: record.last_event + 1, ..record.clone() };
    Write::Change { event: event(record.last_event, state), record }
}

/// Writes the same tests for each store.
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
    async fn what_was_committed_is_there_after_a_restart_bit_by_bit(store) {
        let epoch = store.start().await.unwrap().epoch;
        let job = record(1);
        let ranges = [(0, ODD.map(outcome).to_vec()), (9, vec![failed()])];
        let results = Write::Results { job: job.id.clone(), round: 0, ranges: ranges.to_vec(), finder: finder() };
        store.commit(epoch, vec![submit(&job), results]).await.unwrap();

        let store = store.reopen().await;
        let loaded = store.start().await.unwrap();
        assert_eq!((loaded.epoch, loaded.next_job, loaded.ended.len()), (epoch + 1, 2, 0));
        let [stored] = loaded.active.as_slice() else { panic!("one job") };
        assert_eq!(stored.record, job);
        assert_eq!((stored.toml.as_ref(), stored.search.as_slice()), ("name = \"x\"", [1, 2, 3].as_slice()));
        assert_eq!(stored.results, ranges.map(|(first, outcomes)| stored_range(0, first, outcomes)));
        assert!(stored.last_scores.is_none());
    }

    async fn sealing_replaces_results_by_scores_and_moves_everything_on_at_once(store) {
        let epoch = store.start().await.unwrap().epoch;
        let best = |bits| Scored { generation: 0, candidate: 1, score: f64::from_bits(bits), genome: vec![-0.0, 1.5] };
        let job = record(1);
        let results = Write::Results { job: job.id.clone(), round: 0, ranges: vec![(0, vec![failed()])], finder: finder() };
        let after = JobRecord {
            generations_done: 1,
            last_event: 3,
            state: JobState::Running,
            best: Some(best(ODD[0])),
            first: Some(best(1)),
            winner: Some(best(ODD[2])),
            result_digest: Some(Digest([7; 32])),
            ..job.clone()
        };
        store.commit(epoch, vec![submit(&job), results]).await.unwrap();
        store.commit(epoch, vec![seal(&after, 2)]).await.unwrap();

        let store = store.reopen().await;
        let loaded = store.start().await.unwrap();
        let stored = &loaded.active[0];
        assert_eq!(stored.record, after);
        assert!(stored.record.best.as_ref().is_some_and(|b| b.score.is_sign_negative() && b.genome[0].is_sign_negative()));
        assert_eq!((stored.search.as_slice(), stored.results.len()), ([4, 5].as_slice(), 0));
        let bits = |s: &[Option<f64>]| s.iter().map(|v| v.map(f64::to_bits)).collect::<Vec<_>>();
        let expected: Vec<_> = ODD.iter().map(|b| Some(*b)).chain([None]).collect();
        assert_eq!(bits(stored.last_scores.as_ref().unwrap()), expected);
        assert_eq!(bits(&store.scores(&job.id, 0).await.unwrap().unwrap()), expected);
        assert!(store.scores(&job.id, 1).await.unwrap().is_none());
        let sequence = |events: Vec<v1::JobEvent>| events.iter().map(|e| e.sequence).collect::<Vec<_>>();
        assert_eq!(sequence(store.events(&job.id, 0, 10).await.unwrap()), [1, 2, 3]);
        assert_eq!(sequence(store.events(&job.id, 1, 1).await.unwrap()), [2]);
        assert_eq!(store.result(&job.id).await.unwrap().history.len(), 1);
    }

    async fn what_is_noted_of_a_job_survives_with_all_its_bits_and_tells_nobody(store) {
        let epoch = store.start().await.unwrap().epoch;
        let job = record(1);
        let source = |worker: &str| Source { worker: worker.into(), name: "n".into(), host: "h".into() };
        let claim = |worker: &str, outcome: Outcome| Claim { source: source(worker), outcome, distrusted: worker == "b" };
        let candidate = Scored { generation: 1, candidate: 2, score: f64::from_bits(ODD[0]), genome: vec![0.5] };
        let dispute = Dispute {
            round: 0,
            index: 3,
            what: "candidate 3 of generation 0".to_owned(),
            subject: Subject::Candidate(vec![f64::from_bits(ODD[0]), f64::from_bits(ODD[3])]),
            claims: vec![claim("a", outcome(ODD[0])), claim("b", outcome(ODD[4])), claim("c", failed())],
            ruling: None,
            at_ms: 77,
        };
        let asked = Dispute {
            subject: Subject::Examination(Examination::new(Question::Traces, &candidate)),
            claims: vec![claim("", answer())],
            ruling: Some(Ruling::Tainted),
            ..dispute.clone()
        };
        let poisoned = v1::Poisoned { generation: 1, candidate: 2, genome: vec![-0.0], attempts: 3, ..Default::default() };
        let noted = JobRecord {
            paused: true,
            restarted_from: Some(Origin { job: "j0-x".into(), generations: 4 }),
            disputes: vec![dispute, asked],
            charges: vec![
                Charge { first: 0, count: 1, attempt: true, lost: Some("w".into()) },
                Charge { first: 3, count: 5, attempt: false, lost: None },
            ],
            poisoned: Some(poisoned),
            ..job.clone()
        };
        store.commit(epoch, vec![submit(&job), Write::Note { record: noted.clone() }]).await.unwrap();

        let store = store.reopen().await;
        assert_eq!(store.start().await.unwrap().active[0].record, noted);
        assert_eq!(store.job(&job.id).await.unwrap().unwrap().0, noted);
        assert_eq!(store.events(&job.id, 0, 10).await.unwrap().len(), 1);
    }

    async fn of_several_changes_in_a_commit_the_last_one_stands_and_all_are_told(store) {
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

        // However it ends, nothing of what it needed is left.
        let epoch = store.start().await.unwrap().epoch;
        let last = JobRecord { state: JobState::Cancelled, last_event: 5, ..job.clone() };
        let cancel = Write::Change { record: last.clone(), event: event(5, JobState::Cancelled) };
        store.commit(epoch, vec![cancel, Write::Note { record: last.clone() }]).await.unwrap();
        let store = store.reopen().await;
        let loaded = store.start().await.unwrap();
        assert_eq!(loaded.ended, std::slice::from_ref(&job.id));
        assert_eq!(loaded.active.len(), 1);
    }

    async fn a_restart_takes_over_the_generations_before_it_and_no_others(store) {
        let epoch = store.start().await.unwrap().epoch;
        let (old, new) = (record(1), record(2));
        let sealed = |n| JobRecord { generations_done: n, last_event: 2 * u64::from(n) + 1, ..old.clone() };
        let writes = vec![submit(&old), seal(&sealed(1), 2), seal(&sealed(2), 4), end(&sealed(2), JobState::Tainted)];
        store.commit(epoch, writes).await.unwrap();
        let carry = Write::Carry { from: old.id.clone(), to: new.id.clone(), generations: 1 };
        let carried = JobRecord { generations_done: 1, ..new.clone() };
        store.commit(epoch, vec![submit(&carried), carry]).await.unwrap();

        let store = store.reopen().await;
        let loaded = store.start().await.unwrap();
        assert_eq!(loaded.ended, std::slice::from_ref(&old.id));
        let [stored] = loaded.active.as_slice() else { panic!("one job goes on") };
        let bits = |scores: Option<Vec<Option<f64>>>| -> Vec<_> {
            scores.expect("it was sealed").iter().map(|s| s.map(f64::to_bits)).collect()
        };
        let expected: Vec<_> = ODD.iter().map(|b| Some(*b)).chain([None]).collect();
        assert_eq!(bits(stored.last_scores.clone()), expected);
        assert_eq!(bits(store.scores(&new.id, 0).await.unwrap()), expected);
        assert!(store.scores(&new.id, 1).await.unwrap().is_none());
        assert_eq!(store.result(&old.id).await.unwrap().history.len(), 2, "the old one keeps what it had");
    }

    async fn a_quarantine_survives_and_the_first_reason_stays(store) {
        let epoch = store.start().await.unwrap().epoch;
        let entry = |worker: &str, reason: &str| {
            let reason = reason.to_owned();
            Quarantined { worker: worker.into(), name: "n".into(), reason, at_ms: 5 }
        };
        let writes = ["a", "b", "a"].map(|w| Write::Quarantine(entry(w, "why"))).to_vec();
        store.commit(epoch, writes).await.unwrap();
        store.commit(epoch, vec![Write::Quarantine(entry("a", "again"))]).await.unwrap();
        let store = store.reopen().await;
        assert_eq!(store.start().await.unwrap().quarantined, [entry("a", "why"), entry("b", "why")]);
    }

    async fn rounds_after_the_search_are_all_kept_until_the_job_ends(store) {
        let epoch = store.start().await.unwrap().epoch;
        let job = record(1);
        let results = |round, first, outcome| {
            Write::Results { job: job.id.clone(), round, ranges: vec![(first, vec![outcome])], finder: finder() }
        };
        let over = JobRecord { generations_done: 2, state: JobState::Finishing, last_event: 3, ..job.clone() };
        store.commit(epoch, vec![submit(&job), seal(&over, 2)]).await.unwrap();
        let reporting = JobRecord { state: JobState::Reporting, last_event: 4, ..over.clone() };
        let change = Write::Change { record: reporting.clone(), event: event(4, JobState::Reporting) };
        store.commit(epoch, vec![results(2, 1, failed()), results(2, 0, answer()), change]).await.unwrap();
        store.commit(epoch, vec![results(3, 1, answer())]).await.unwrap();

        let store = store.reopen().await;
        let loaded = store.start().await.unwrap();
        let kept = [(2, 0, vec![answer()]), (2, 1, vec![failed()]), (3, 1, vec![answer()])];
        let kept = kept.map(|(round, first, outcomes)| stored_range(round, first, outcomes)).to_vec();
        assert_eq!((&loaded.active[0].record, &loaded.active[0].results), (&reporting, &kept));
        store.commit(loaded.epoch, vec![end(&reporting, JobState::Cancelled)]).await.unwrap();
        assert!(store.start().await.unwrap().active.is_empty());
    }

    async fn writes_of_an_earlier_epoch_change_nothing(store) {
        let old = store.start().await.unwrap().epoch;
        let job = record(1);
        let results = |first| Write::Results { job: job.id.clone(), round: 0, ranges: vec![(first, vec![failed()])], finder: finder() };
        store.commit(old, vec![submit(&job), results(0)]).await.unwrap();
        let before = store.start().await.unwrap();
        let done = JobRecord { state: JobState::Succeeded, generations_done: 1, last_event: 3, ..job.clone() };
        let report = Write::Report { record: done.clone(), report: vec![1], event: event(3, JobState::Succeeded) };
        let late = [submit(&record(2)), results(1), seal(&done, 2), end(&job, JobState::Cancelled), report];
        for write in late.into_iter().map(|w| vec![w]).chain([vec![results(2), end(&job, JobState::Failed)], vec![]]) {
            let refused = store.commit(old, write).await;
            let superseded = matches!(refused, Err(StoreError::Superseded { own, by }) if (own, by) == (old, before.epoch));
            assert!(superseded, "{refused:?}");
        }
        assert_eq!(store.events(&job.id, 0, 10).await.unwrap(), [event(1, JobState::Queued)]);
        assert!(store.result(&job.id).await.unwrap().history.is_empty());
        assert_eq!(store.jobs(u64::MAX, 10, &[]).await.unwrap(), std::slice::from_ref(&job));
        store.commit(before.epoch, vec![results(1)]).await.unwrap();
        let after = store.start().await.unwrap();
        assert_eq!(after.active[0].results, [stored_range(0, 0, vec![failed()]), stored_range(0, 1, vec![failed()])]);
        assert_eq!(after.active[0].record, before.active[0].record);
    }

    async fn a_commit_that_fails_leaves_nothing_behind(store) {
        let epoch = store.start().await.unwrap().epoch;
        // The second breaks the uniqueness of request ids.
        let twin = JobRecord { number: 2, id: JobId::new(2, &Digest([5; 32])), ..record(1) };
        assert!(store.commit(epoch, vec![submit(&record(1)), submit(&twin)]).await.is_err());
        assert!(store.jobs(u64::MAX, 10, &[]).await.unwrap().is_empty());
        store.commit(epoch, vec![submit(&record(1))]).await.unwrap();
        assert!(store.commit(epoch, vec![submit(&twin)]).await.is_err(), "nor does it come later");
        assert_eq!(store.jobs(u64::MAX, 10, &[]).await.unwrap(), [record(1)]);
        store.commit(epoch, vec![submit(&record(2))]).await.unwrap();
    }

    async fn a_large_generation_comes_back_bit_by_bit(store) {
        let epoch = store.start().await.unwrap().epoch;
        let job = record(1);
        // Any bits at all, among them signalling NaNs, in ranges with gaps between them.
        let bits = |i: u32| u64::from(i).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let range = |first: u32| (first, (first..first + 9).map(|i| outcome(bits(i))).collect::<Vec<_>>());
        let ranges: Vec<_> = (0..10_000).step_by(10).map(range).collect();
        let results = Write::Results { job: job.id.clone(), round: 0, ranges: ranges.clone(), finder: finder() };
        store.commit(epoch, vec![submit(&job), results]).await.unwrap();
        let store = store.reopen().await;
        let loaded = store.start().await.unwrap();
        let expected: Vec<_> = ranges.into_iter().map(|(first, outcomes)| stored_range(0, first, outcomes)).collect();
        assert!(loaded.active[0].results == expected);

        let scores: Vec<_> = (0..10_000).map(|i| (i % 7 > 0).then_some(f64::from_bits(bits(i)))).collect();
        let sealed = SealedGeneration { scores: scores.clone(), statistics: v1::GenerationSealed::default() };
        let after = JobRecord { generations_done: 1, last_event: 2, ..job.clone() };
        let (search, events) = (vec![9; 3_000_000], vec![event(2, JobState::Running)]);
        let seal = Write::Seal { record: after, sealed: sealed.clone(), search: search.clone(), events };
        store.commit(loaded.epoch, vec![seal]).await.unwrap();
        let store = store.reopen().await;
        let stored = store.start().await.unwrap().active.remove(0);
        assert!(stored.search == search && stored.results.is_empty());
        let statistics = sealed.statistics;
        assert!(SealedGeneration { scores: stored.last_scores.unwrap(), statistics } == sealed);
    }

    async fn names_keep_every_letter(store) {
        let epoch = store.start().await.unwrap().epoch;
        // The last two look the same, and are not.
        let names = ["机器人 🦎", "'; DROP TABLE jobs; --", "a\\b\"c\nd\te %s $1 ?", "\u{202e}gnal", "\u{e9}", "e\u{301}"];
        let named = |(i, name): (usize, &&str)| {
            JobRecord { name: name.to_string(), request_id: name.to_string(), ..record(i as u64 + 1) }
        };
        let jobs: Vec<_> = names.iter().enumerate().map(named).collect();
        let submit_named = |job: &JobRecord| match submit(job) {
            Write::Submit { record, search, event, .. } => {
                Write::Submit { toml: record.name.as_str().into(), record, search, event }
            }
            other => other,
        };
        store.commit(epoch, jobs.iter().map(submit_named).collect()).await.unwrap();
        let store = store.reopen().await;
        for job in &jobs {
            assert_eq!(store.job_of_request(&job.request_id).await.unwrap().as_ref(), Some(job));
            assert_eq!(store.job(&job.id).await.unwrap(), Some((job.clone(), job.name.clone())));
        }
        assert!(store.job_of_request("\u{c9}").await.unwrap().is_none(), "letters have a case");
    }

    async fn who_comes_after_the_end_is_told_so_and_the_end_may_come_twice(store) {
        let epoch = store.start().await.unwrap().epoch;
        store.commit(epoch, vec![submit(&record(1))]).await.unwrap();
        store.release(epoch).await.unwrap();
        store.close().await.unwrap();
        store.close().await.unwrap();
        for late in [store.commit(epoch, vec![]).await.err(), store.job(&record(1).id).await.err()] {
            assert!(matches!(late, Some(StoreError::Closed)), "{late:?}");
        }
    }

    async fn jobs_are_found_by_id_by_request_and_in_pages(store) {
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

    async fn an_ended_job_keeps_its_report_and_drops_what_nobody_needs(store) {
        let epoch = store.start().await.unwrap().epoch;
        let job = record(1);
        let results = Write::Results { job: job.id.clone(), round: 0, ranges: vec![(0, vec![failed()])], finder: finder() };
        let done = JobRecord { state: JobState::Succeeded, last_event: 2, ..job.clone() };
        let report = Write::Report {
            record: done.clone(),
            report: b"{\"winner\":1}".to_vec(),
            event: event(2, JobState::Succeeded),
        };
        store.commit(epoch, vec![submit(&job), results, report]).await.unwrap();
        let store = store.reopen().await;
        assert_eq!(store.result(&job.id).await.unwrap().report, b"{\"winner\":1}");
        assert_eq!(store.job(&job.id).await.unwrap().unwrap().0, done);
        assert!(store.start().await.unwrap().active.is_empty());
    }
}

#[tokio::test]
async fn a_closed_sqlite_store_is_one_file_with_everything_in_it() {
    let file = File::new().await;
    let epoch = file.start().await.unwrap().epoch;
    file.commit(epoch, vec![submit(&record(1))]).await.unwrap();
    let names = || {
        let entries = std::fs::read_dir(file.folder.path()).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    assert_eq!(names(), ["s.db", "s.db-wal"]);
    file.close().await.unwrap();
    assert_eq!(names(), ["s.db"]);
    let copy = file.folder.path().join("copy.db");
    std::fs::copy(file.folder.path().join("s.db"), &copy).unwrap();
    assert_eq!(open_file(&copy).await.jobs(u64::MAX, 10, &[]).await.unwrap(), [record(1)]);
}

#[tokio::test]
async fn what_can_not_be_a_store_is_refused_with_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let refused = async |path: &Path| match SqliteStore::open(path).await {
        Ok(_) => panic!("{} opened", path.display()),
        Err(error) => (error.to_string(), error),
    };
    let (text, error) = refused(&folder.path().join("none/s.db")).await;
    assert!(matches!(error, StoreError::Open { .. }) && text.contains("there is no folder"), "{text}");
    let (text, error) = refused(folder.path()).await;
    assert!(matches!(error, StoreError::Open { .. }) && text.contains("it is a folder"), "{text}");

    let text_file = folder.path().join("letter.txt");
    std::fs::write(&text_file, "Dear reader, this is no database. ".repeat(100)).unwrap();
    let (text, error) = refused(&text_file).await;
    assert!(matches!(error, StoreError::Foreign { .. }), "{text}");

    let used = folder.path().join("used.db");
    let _store = open_file(&used).await;
    let (text, error) = refused(&used).await;
    assert!(matches!(error, StoreError::InUse { .. }) && text.contains("in use by another coordinator"), "{text}");
}

#[tokio::test]
async fn a_database_of_another_program_or_version_is_left_alone() {
    use sqlx::ConnectOptions as _;
    let folder = tempfile::tempdir().unwrap();
    for (name, sql, reason) in [
        ("other.db", "CREATE TABLE letters (a)", "another program"),
        (
            "newer.db",
            "CREATE TABLE a (a); PRAGMA application_id = 1702260583; PRAGMA user_version = 99",
            "newer version",
        ),
        (
            "older.db",
            "CREATE TABLE a (a); PRAGMA application_id = 1702260583; PRAGMA user_version = 1",
            "an older version of evogait, whose jobs have no finish",
        ),
    ] {
        let path = folder.path().join(name);
        let options = sqlx::sqlite::SqliteConnectOptions::new().filename(&path).create_if_missing(true);
        let mut connection = options.connect().await.unwrap();
        sqlx::raw_sql(sql).execute(&mut connection).await.unwrap();
        sqlx::Connection::close(connection).await.unwrap();
        let error = SqliteStore::open(&path).await.err().expect("refused").to_string();
        assert!(error.contains(reason), "{error}");
    }
}
