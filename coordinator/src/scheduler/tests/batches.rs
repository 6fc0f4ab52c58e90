//! Tests of procedures that wait for batches, and of rounds that a prefix of their tasks settles.

use super::*;

#[test]
fn waiting_job_goes_on_with_its_batch() {
    for restart in [None, Some(false), Some(true)] {
        let mut rig = Rig::new();
        let fake = Fake::new(3, 3).serving();
        let job = rig.submit_job(job_of("a", fake.clone()));
        rig.connect("w", 1);
        let offer = |rig: &mut Rig, batch: &[u8]| {
            let answer = on_offer(&mut rig.scheduler, rig.now, &job, batch).expect("the job has not ended");
            rig.commit_and_collect();
            answer.map(|record| record.state)
        };
        assert!(offer(&mut rig, b"batch").is_err(), "a running job accepts no batch");
        for round in 1..3 {
            rig.work_off();
            let record = rig.stored(&job);
            assert_eq!((record.state, record.rounds_sealed), (JobState::Waiting, round));
            assert_eq!(rig.waits_for(&job), "waits for a client's batch");
            assert_eq!(demand(&rig.scheduler).wanted, 0);
            if restart == Some(false) {
                rig.restart();
                rig.connect("w", 1);
                assert_eq!((rig.stored(&job), rig.given.len()), (record.clone(), 0));
            }
            assert!(offer(&mut rig, b"").is_err());
            assert_eq!(rig.stored(&job), record, "a refused batch changes nothing");
            assert_eq!(offer(&mut rig, b"batch"), Ok(JobState::Running));
            if restart == Some(true) {
                rig.given.clear();
                rig.restart();
                rig.connect("w", 1);
            }
        }
        rig.work_off();
        assert_eq!(rig.stored(&job).result_digest, Some(digest_of("a", fake).0), "restart after: {restart:?}");
        assert!(on_offer(&mut rig.scheduler, rig.now, &job, b"batch").is_none());
    }
}

#[test]
fn late_result_is_compared_while_job_waits() {
    let mut rig = Rig::new();
    let fake = Fake::new(2, 2).serving();
    let job = rig.submit_job(job_of("a", fake.clone()));
    rig.connect("w", 1);
    let first = rig.take().unwrap();
    rig.answer(&first);
    rig.work_off();
    assert_eq!(rig.answer(&first), Verdict::Duplicate);
    assert_eq!(rig.deliver_wrong(&rig.given_to("x", &first)), Verdict::Conflict);
    rig.connect("third", 1);
    let question = rig.take_of("third").expect("the third worker gets the disputed task");
    rig.answer(&question);
    assert_eq!((rig.quarantined(), rig.stored(&job).state), (vec!["x".to_owned()], JobState::Waiting));
    let answer = on_offer(&mut rig.scheduler, rig.now, &job, b"batch");
    assert!(answer.is_some_and(|answer| answer.is_ok()));
    rig.commit_and_collect();
    rig.work_off();
    assert_eq!(rig.stored(&job).result_digest, Some(digest_of("a", fake).0));
}

#[test]
fn round_settled_by_prefix_cancels_later_tasks() {
    let mut rig = Rig::new();
    let fake = Fake::new(40, 2).settled_by(3);
    let job = rig.submit_job(job_of("a", fake.clone()));
    rig.connect("w", 10);
    let given: Vec<Given> = std::iter::from_fn(|| rig.take()).collect();
    assert_eq!(given.len(), 10);
    // A result beyond the prefix settles nothing.
    assert_eq!(rig.answer(&given[9]), Verdict::Accepted);
    assert_eq!(rig.stored(&job).rounds_sealed, 0);
    let mut answered = 0;
    while rig.stored(&job).rounds_sealed == 0 {
        assert_eq!(rig.answer(&given[answered]), Verdict::Accepted);
        answered += 1;
    }
    assert!((1..8).contains(&answered), "{answered}");
    let settled = at_once(rig.store.digests(&job, 0)).unwrap().len() as u32;
    for later in &given[answered..9] {
        assert!(rig.cancelled.contains(&later.id()), "{:?}", later.range());
        assert!(later.range().first + later.range().count > settled);
    }
    let beyond = given.iter().find(|g| g.range().first >= settled).expect("a range beyond the prefix").clone();
    assert_eq!(rig.answer(&beyond), Verdict::Obsolete);
    assert_eq!(rig.deliver_wrong(&beyond), Verdict::Obsolete, "a result beyond the prefix is not compared");
    rig.work_to(&job, 2);
    assert_eq!(rig.answer(&beyond), Verdict::Obsolete, "the verdict is the same two rounds later");
    rig.work_off();
    assert_eq!(rig.stored(&job).result_digest, Some(digest_of("a", fake).0));
}

#[test]
fn shared_bytes_and_text_reach_a_session_once() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 4, 2);
    rig.connect("w", 4);
    let sent = |rig: &Rig| -> Vec<(bool, Option<String>)> {
        let shared = |g: &Given| g.assign.shared.as_deref().map(|bytes| String::from_utf8_lossy(bytes).into_owned());
        rig.given.iter().map(|g| (g.assign.toml.is_some(), shared(g))).collect()
    };
    assert_eq!(sent(&rig), [(true, None), (false, None), (false, None), (false, None)], "round 0 shares nothing");
    rig.work_to(&job, 1);
    let searching = Some("searching".to_owned());
    assert_eq!(sent(&rig)[0], (false, searching.clone()));
    assert!(sent(&rig)[1..].iter().all(|sent| *sent == (false, None)));
    let digest = rig.given[0].assign.shared_digest;
    assert!(rig.given.iter().all(|g| g.assign.shared_digest == digest));
    // A new session gets both again, and each phase shares other bytes.
    rig.connect("v", 1);
    let given = rig.take_of("v");
    assert!(given.is_none_or(|g| g.assign.toml.is_some() && g.assign.shared.as_deref() == Some(b"searching")));
    rig.work_to(&job, 2);
    assert_eq!(rig.given.iter().filter(|g| &*g.worker.0 == "w" && g.assign.shared.is_some()).count(), 1);
    assert!(rig.given.iter().all(|g| g.assign.shared_digest != digest));
    rig.restart();
    rig.given.clear();
    rig.connect("w", 2);
    let both = Some("finishing".to_owned());
    assert_eq!(sent(&rig), [(true, both), (false, None)]);
}
