//! Tests of results that don't belong to an issued assignment or are invalid.

use super::*;
use crate::limits::MAX_QUARANTINED;
use crate::store::Quarantined;

/// State that a refused result must not change.
fn state(rig: &Rig, job: &JobId) -> (JobRecord, Option<(u32, u32)>, Vec<AssignmentId>) {
    (rig.stored(job), rig.scheduler.round(job), rig.scheduler.leases.all.keys().copied().collect())
}

fn marks(rig: &mut Rig) -> usize {
    rig.scheduler.take_notes().iter().filter(|note| matches!(note, Note::Marked { .. })).count()
}

fn at(id: &str, address: &str, credential: &str) -> Greeting {
    Greeting { address: address.to_owned(), credential: credential.into(), ..greeting(id, 1) }
}

/// Deliveries of assignments that were not issued.
fn forgeries(given: &Given, other: &Given) -> Vec<Completed> {
    let right = || given.completed(given.delivery());
    let Range { round, first, count } = given.range();
    let range = |round, first, count| Completed { range: Range { round, first, count }, ..right() };
    let mut turned = right();
    turned.permit[40] ^= 1;
    vec![
        Completed { permit: Vec::new(), ..right() },
        Completed { permit: right().permit[..63].to_vec(), ..right() },
        turned,
        Completed { permit: other.assign.permit.clone(), ..right() },
        Completed { worker: other.worker.clone(), ..right() },
        Completed { job: other.job().clone(), ..right() },
        Completed { assignment: other.id(), ..right() },
        Completed { assignment: AssignmentId(u64::MAX), ..right() },
        range(round + 1, first, count),
        range(round, first + 1, count),
        range(round, first, count + 1),
        range(round, first, 0),
    ]
}

#[test]
fn result_without_its_permit_is_refused() {
    let mut rig = Rig::new();
    let (job, second) = (rig.submit("a", 4, 2), rig.submit("b", 4, 2));
    rig.greet(at("w", "10.0.0.1:5", "token"));
    rig.greet(at("v", "10.0.0.2:5", ""));
    let (given, other) = (rig.take_of("w").unwrap(), rig.take_of("v").unwrap());
    assert_ne!(given.job(), other.job());
    let before = (state(&rig, &job), state(&rig, &second));
    for (i, forged) in forgeries(&given, &other).into_iter().enumerate() {
        for (host, credential) in [("", ""), ("10.0.0.9", "token"), ("10.0.0.1", "other")] {
            let caller = Caller { host: host.into(), credential: credential.into() };
            let refused = rig.deliver(Completed { caller, ..forged.clone() });
            assert!(matches!(refused, Err(RefusedResult::Unissued { .. })), "{i}: {refused:?}");
            assert_eq!((state(&rig, &job), state(&rig, &second)), before, "{i}");
        }
    }
    assert_eq!(marks(&mut rig), 0, "an unauthenticated delivery must not mark the worker");
    for unknown in 0..100 {
        let worker = WorkerId(format!("unknown{unknown}").into());
        rig.deliver(Completed { worker, ..given.completed(given.delivery()) }).unwrap_err();
    }
    assert_eq!(marks(&mut rig), 0);
    let caller = Caller { host: "10.0.0.1".into(), credential: "token".into() };
    let forged = Completed { permit: Vec::new(), caller, ..given.completed(given.delivery()) };
    for i in 1..=MAX_MARKS {
        assert!(!rig.is_quarantined("w"));
        let refused = rig.deliver(forged.clone()).unwrap_err();
        assert!(refused.to_string().contains("was never issued to worker w"), "{refused}");
        assert_eq!(marks(&mut rig), 1, "{i}");
    }
    assert_eq!(rig.quarantined(), ["w"]);
    assert_eq!(rig.complete(forged), Verdict::Quarantined);
}

#[test]
fn malformed_result_ends_its_lease_at_no_cost() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 1, 1);
    rig.connect("bad", 1);
    let result = |bytes: &[u8]| -> Arc<[u8]> { bytes.into() };
    let right = result(&fake::encode(Some(1)));
    let malformed = [
        vec![],
        vec![right.clone(), right.clone()],
        vec![result(&[])],
        vec![result(&right[..8])],
        vec![result(&[&right, [0].as_slice()].concat())],
        vec![result(&[2; 9])],
        vec![result(&[0, 1, 0, 0, 0, 0, 0, 0, 0])],
    ];
    for (i, results) in malformed.into_iter().enumerate() {
        let id = format!("bad{i}");
        rig.restart();
        rig.given.clear();
        rig.connect(&id, 1);
        let given = rig.take_of(&id).unwrap();
        let refused = rig.deliver(given.completed(Delivery::Results(results)));
        assert!(matches!(refused, Err(RefusedResult::Count { .. } | RefusedResult::Result(_))), "{i}: {refused:?}");
        assert_eq!((marks(&mut rig), leased(&rig, &job), rig.scheduler.round(&job)), (1, 0, Some((0, 1))));
        assert!(rig.stored(&job).charges.is_empty(), "a refused result charges no task");
        rig.connect("good", 1);
        assert_eq!(rig.take_of("good").expect("another worker gets the task").range(), given.range());
        assert!(rig.quarantined().is_empty());
    }
    let mut on_other_engine = rig.given_to("good", &rig.early("good", &job, 0..1));
    on_other_engine.assign.range.count = 1;
    let completed = on_other_engine.completed(on_other_engine.delivery());
    let refused = rig.deliver(Completed { engine: Digest([9; 32]), ..completed });
    assert!(matches!(refused, Err(RefusedResult::Engine { .. })), "{refused:?}");
}

#[test]
fn third_refused_result_quarantines_the_worker() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 5, 2);
    rig.connect("bad", 1);
    rig.answer(&rig.given[0].clone());
    for i in 1..=MAX_MARKS {
        assert_eq!(rig.quarantined().len(), 0);
        let given = loop {
            // The worker gets no work of the job for a while.
            match rig.given.pop().filter(|g| !rig.cancelled.contains(&g.id()) && g.range().first > 0) {
                Some(given) => break given,
                None => {
                    rig.now.since_start += LEASE / 2;
                    rig.connect("bad", 1);
                    rig.advance(LEASE / 2);
                }
            }
        };
        rig.deliver(given.completed(Delivery::Results(Vec::new()))).unwrap_err();
        assert_eq!(marks(&mut rig), 1, "{i}");
    }
    assert_eq!(rig.quarantined(), ["bad"]);
    let record = rig.stored(&job);
    assert_eq!((record.disputes.len(), record.charges.len()), (1, 0), "its earlier result is disputed");
    assert!(rig.drained.contains(&WorkerId("bad".into())));
    let views = workers(&rig.scheduler);
    assert!(views[0].reason.contains("3 of its results were refused"), "{views:?}");
    rig.given.clear();
    rig.connect("d", 1);
    rig.connect("e", 1);
    rig.work_off();
    rig.assert_right(&job, 5, 2);
}

#[test]
fn permit_is_valid_only_on_its_own_store() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 3, 1);
    rig.connect("w", 1);
    let given = rig.take().unwrap();
    let foreign = {
        let other = Rig::new();
        let (worker, job) = (given.worker.clone(), given.job().clone());
        let issued = Issued { assignment: given.id(), worker: &worker, job: &job, range: given.range() };
        other.key.issue(issued, &given.assign.tasks)
    };
    rig.restart();
    let right = given.completed(given.delivery());
    let refused = rig.deliver(Completed { permit: foreign.clone(), ..right.clone() });
    assert!(matches!(refused, Err(RefusedResult::Unissued { .. })), "{refused:?}");
    let claim = Running { permit: foreign, ..given.claim() };
    let welcome = rig.greet(Greeting { running: vec![claim], ..greeting("w", 1) });
    assert_eq!((welcome.keep.len(), welcome.drop), (0, vec![given.id()]));
    assert_eq!(rig.complete(right), Verdict::Accepted);
    rig.given.retain(|g| g.range() != given.range());
    rig.work_off();
    rig.assert_right(&job, 3, 1);
}

#[test]
fn quarantine_keeps_a_bounded_number_of_entries() {
    let mut rig = Rig::new();
    let entry = |i: usize| Quarantined {
        worker: format!("w{i:05}").into(),
        name: "".into(),
        host: "".into(),
        credential: "".into(),
        reason: String::new(),
        at_ms: i as i64,
    };
    at_once(rig.store.commit(
        rig.epoch,
        (0..MAX_QUARANTINED).map(|i| Write::Quarantine { entry: entry(i), instead_of: None }).collect(),
    ));
    rig.restart();
    rig.now.unix_ms = MAX_QUARANTINED as i64;
    let finder = crate::record::Claimant { worker: "one more".into(), host: "".into() };
    let source = crate::record::Source { finder, name: "".into() };
    trust::quarantine(&mut rig.scheduler, rig.now, &source, "it is a test");
    rig.commit_and_collect();
    let all = rig.quarantined();
    assert_eq!(all.len(), MAX_QUARANTINED);
    assert!(!rig.is_quarantined("w00000") && rig.is_quarantined("w00001") && rig.is_quarantined("one more"));
    rig.restart();
    assert_eq!(rig.quarantined(), all, "the store has the same entries");
}

#[test]
fn worker_that_reconnects_keeps_its_marks() {
    let mut rig = Rig::new();
    rig.submit("a", 1, 1);
    rig.connect("w", 1);
    let given = rig.take_of("w").expect("the worker has an assignment");
    for _ in 0..MAX_MARKS {
        assert!(!rig.is_quarantined("w"));
        let session = rig.connect("w", 1);
        rig.deliver(Completed { permit: Vec::new(), ..given.completed(given.delivery()) }).unwrap_err();
        rig.disconnect("w", session);
        rig.advance(LEASE);
    }
    assert_eq!(rig.quarantined(), ["w"]);
}
