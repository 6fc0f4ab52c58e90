//! The promises about results that differ.

use super::*;
use crate::record::Ruling;

/// A job of one candidate, committed by "a" and disputed by "b"; a third worker has not come yet.
fn disputed(honest: &str) -> (Rig, JobId, Given) {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    rig.connect("a", 1);
    let given = rig.take().unwrap();
    rig.connect("b", 1);
    let by = |who: &str| if who == honest { given.delivery() } else { given.wrong(0) };
    assert_eq!(rig.complete(given.completed(by("a"))), Verdict::Accepted);
    let other = Completed { worker: WorkerId("b".into()), ..given.completed(by("b")) };
    assert_eq!(rig.complete(other), Verdict::Conflict);
    (rig, job, given)
}

fn rulings(rig: &Rig, job: &JobId) -> Vec<Option<Ruling>> {
    rig.stored(job).disputes.iter().map(|d| d.ruling).collect()
}

#[test]
fn a_round_with_a_dispute_is_not_sealed_and_says_what_it_waits_for() {
    let (mut rig, job, _) = disputed("a");
    rig.work_off();
    assert_eq!(rig.scheduler.round(&job), Some((2, 2)), "all is done");
    assert_eq!(rig.stored(&job).generations_done, 0, "and nothing is sealed");
    let why = rig.scheduler.waits_for(&job).unwrap();
    assert!(why.contains("waits for another worker: two results of candidate 0 of generation 0 differ"), "{why}");
    assert_eq!(rulings(&rig, &job), [None]);
    let events = at_once(rig.store.events(&job, 0, 100));
    let told = events.iter().filter(|e| matches!(e.event, Some(v1::job_event::Event::Dispute(_)))).count();
    assert_eq!(told, 1, "whoever watches is told");
}

#[test]
fn a_third_worker_decides_and_whoever_stands_alone_gets_no_more_work() {
    for (honest, ruling) in [("a", Ruling::Upheld), ("b", Ruling::Corrected)] {
        let liar = if honest == "a" { "b" } else { "a" };
        let (mut rig, job, first) = disputed(honest);
        rig.connect("c", 1);
        let question = rig.take_of("c").expect("the third is asked");
        assert_eq!(question.range(), first.range());
        assert!(rig.scheduler.waits_for(&job).is_some_and(|w| w.contains("another worker is deciding")));
        let delivery = question.delivery();
        assert_eq!(rig.complete(question.completed(delivery)), Verdict::Accepted);
        assert_eq!(rulings(&rig, &job), [Some(ruling)]);

        let workers = rig.scheduler.workers();
        let quarantined: Vec<&str> = workers.iter().filter(|w| w.quarantined).map(|w| w.id.as_str()).collect();
        assert_eq!(quarantined, [liar]);
        assert!(workers.iter().any(|w| w.quarantined && w.reason.contains("is not what two others found")));
        assert!(rig.drained.contains(&WorkerId(liar.into())), "it is told");
        let late = Completed { worker: WorkerId(liar.into()), ..first.completed(first.delivery()) };
        assert_eq!(rig.complete(late), Verdict::Quarantined);

        // It stays so, whatever starts again; under another id it may come back.
        rig.given.clear();
        rig.restart(|_| 2);
        rig.connect(liar, 4);
        assert!(rig.given.is_empty(), "nothing for {liar}");
        assert!(rig.scheduler.waits_for(&job).is_some_and(|w| w.contains("quarantined")));
        rig.connect("new", 1);
        rig.work_off();
        assert_eq!(rig.stored(&job).result_digest, Some(expected_digest("a", 2, 2)), "honest: {honest}");
    }
}

#[test]
fn what_was_decided_holds_after_a_restart_in_mid_round() {
    let (mut rig, job, _) = disputed("b");
    rig.given.clear();
    rig.restart(|_| 2);
    assert_eq!(rulings(&rig, &job), [None], "an open dispute survives");
    rig.connect("c", 1);
    let question = rig.take_of("c").unwrap();
    let delivery = question.delivery();
    rig.complete(question.completed(delivery));
    assert_eq!(rulings(&rig, &job), [Some(Ruling::Corrected)]);
    assert_eq!(rig.stored(&job).generations_done, 0);
    rig.given.clear();
    rig.restart(|_| 2);
    rig.connect("d", 1);
    rig.work_off();
    assert_eq!(rig.stored(&job).result_digest, Some(expected_digest("a", 2, 2)));
}

#[test]
fn the_third_is_on_another_machine_where_there_is_one() {
    let (mut rig, job, _) = disputed("a");
    rig.scheduler.pause(rig.now, &job, true);
    rig.connect("c", 1);
    let elsewhere = Greeting { address: "10.0.0.2:1".to_owned(), ..greeting("z", 1) };
    rig.scheduler.connect(rig.now, elsewhere);
    rig.scheduler.pause(rig.now, &job, false);
    rig.settle();
    let mut asked = rig.scheduler.leases.values().filter(|l| l.kind == lease::Kind::Decides);
    assert_eq!(asked.next().map(|l| l.worker.to_string()).as_deref(), Some("z"), "\"c\" is where the others are");
}

#[test]
fn a_sealed_value_never_changes_and_the_job_is_tainted_if_it_loses() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 3);
    rig.connect("liar", 1);
    let first = rig.take().unwrap();
    rig.complete(first.completed(first.wrong(0)));
    let second = rig.take().unwrap();
    let delivery = second.delivery();
    rig.complete(second.completed(delivery));
    let sealed = at_once(rig.store.scores(&job, 0)).unwrap();
    assert_eq!(rig.stored(&job).generations_done, 1);

    // Somebody who had it first delivers late; after a restart, too, it is known who said what.
    rig.given.clear();
    rig.restart(|_| 2);
    let late = Completed { worker: WorkerId("late".into()), ..first.completed(first.delivery()) };
    assert_eq!(rig.complete(late), Verdict::Conflict);
    assert_eq!(rulings(&rig, &job), [None]);
    // Meanwhile the job goes on, but it does not end.
    rig.connect("late", 1);
    rig.work_off();
    assert_eq!((rig.stored(&job).state, rig.stored(&job).generations_done), (JobState::Reporting, 3));
    assert_eq!(rig.scheduler.round(&job).map(|(done, total)| done == total), Some(true));

    rig.connect("third", 1);
    let question = rig.take_of("third").unwrap();
    assert_eq!((question.range().round, question.range().first, question.range().count), (0, 0, 1));
    let delivery = question.delivery();
    assert_eq!(rig.complete(question.completed(delivery)), Verdict::Accepted);
    let record = rig.stored(&job);
    assert_eq!(record.state, JobState::Tainted);
    let bits = format!("{:016x}", sealed[0].unwrap().to_bits());
    for part in ["candidate 0 of generation 0", "sealed in round 0", &bits, "liar", "evogait restart"] {
        assert!(record.reason.contains(part), "{part}: {}", record.reason);
    }
    let same = |a: &[Option<f64>], b: &[Option<f64>]| a.iter().zip(b).all(|(a, b)| round::same_bits(*a, *b));
    assert!(same(&at_once(rig.store.scores(&job, 0)).unwrap(), &sealed), "what is sealed stays");
    assert!(rig.scheduler.quarantined.contains_key(&WorkerId("liar".into())), "though it is not connected");
}

#[test]
fn examinations_are_disputed_like_evaluations() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 6, 1);
    rig.connect("w", 1);
    let given = rig.work_to_finish().unwrap();
    rig.complete(given.completed(given.wrong(0)));
    let other = Completed { worker: WorkerId("x".into()), ..given.completed(given.delivery()) };
    assert_eq!(rig.complete(other), Verdict::Conflict);
    rig.connect("y", 1);
    rig.work_off();
    assert_eq!(rig.stored(&job).result_digest, Some(expected_digest("a", 6, 1)));

    // In a round that is sealed it taints.
    let mut rig = Rig::new();
    let job = rig.submit("a", 6, 1);
    rig.connect("w", 1);
    let given = rig.work_to_finish().unwrap();
    rig.complete(given.completed(given.wrong(0)));
    while rig.stored(&job).state == JobState::Finishing {
        let next = rig.take().unwrap();
        let delivery = next.delivery();
        rig.complete(next.completed(delivery));
    }
    let other = Completed { worker: WorkerId("x".into()), ..given.completed(given.delivery()) };
    assert_eq!(rig.complete(other), Verdict::Conflict);
    rig.connect("y", 1);
    rig.work_off();
    let record = rig.stored(&job);
    assert_eq!(record.state, JobState::Tainted, "{}", record.reason);
}

#[test]
fn three_answers_that_all_differ_ask_a_fourth() {
    let (mut rig, job, _) = disputed("a");
    rig.connect("c", 1);
    let question = rig.take_of("c").unwrap();
    assert_eq!(rig.complete(question.completed(question.wrong(5))), Verdict::Conflict);
    assert_eq!(rulings(&rig, &job), [None]);
    rig.connect("d", 1);
    let question = rig.take_of("d").unwrap();
    let delivery = question.delivery();
    rig.complete(question.completed(delivery));
    assert_eq!(rulings(&rig, &job), [Some(Ruling::Upheld)]);
    assert_eq!(rig.scheduler.quarantined.len(), 2);
}

#[test]
fn a_worker_that_contradicts_itself_has_no_say() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 1);
    rig.connect("a", 1);
    let given = rig.take().unwrap();
    rig.complete(given.completed(given.wrong(0)));
    assert_eq!(rig.complete(given.completed(given.delivery())), Verdict::Conflict);
    rig.connect("b", 1);
    let question = rig.take_of("b").unwrap();
    let delivery = question.delivery();
    rig.complete(question.completed(delivery));
    assert_eq!(rulings(&rig, &job), [None], "one word against none");
    rig.connect("c", 1);
    rig.work_off();
    assert_eq!(rulings(&rig, &job), [Some(Ruling::Corrected)]);
    assert_eq!(rig.stored(&job).result_digest, Some(expected_digest("a", 2, 1)));
}
