//! Tests of results that differ.

use super::*;
use crate::record::Event;

/// A job with its first task committed by worker "a" and disputed by worker "b". No third worker is connected yet.
fn disputed(correct: &str) -> (Rig, JobId, Given) {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    rig.connect("a", 1);
    let given = rig.take().unwrap();
    rig.connect("b", 1);
    let by = |worker: &str| if worker == correct { given.delivery() } else { given.wrong(0) };
    assert_eq!(rig.complete(given.completed(by("a"))), Verdict::Accepted);
    let other = rig.given_to("b", &given).completed(by("b"));
    assert_eq!(rig.complete(other), Verdict::Conflict);
    (rig, job, given)
}

#[test]
fn disputed_round_is_not_sealed_and_reports_why() {
    let (mut rig, job, _) = disputed("a");
    rig.work_off();
    assert_eq!(rig.scheduler.round(&job), Some((2, 2)), "all tasks are done");
    assert_eq!(rig.stored(&job).rounds_sealed, 0, "the round is not sealed");
    let why = rig.waits_for(&job);
    assert!(why.contains("waits for another worker: two results of task 0 of round 0 differ"), "{why}");
    assert_eq!(rig.rulings(&job), [None]);
    let events = at_once(rig.store.events(&job, 0, 100));
    let told = events.iter().filter(|e| matches!(e.event.event, Event::Dispute(_))).count();
    assert_eq!(told, 1, "number of dispute events for watching clients");
}

#[test]
fn third_worker_decides_and_minority_is_quarantined() {
    for (correct, ruling) in [("a", Ruling::Upheld), ("b", Ruling::Corrected)] {
        let faulty = if correct == "a" { "b" } else { "a" };
        let (mut rig, job, first) = disputed(correct);
        rig.connect("c", 1);
        let question = rig.take_of("c").expect("the third worker is the arbiter");
        assert_eq!(question.range(), first.range());
        assert!(rig.waits_for(&job).contains("another worker is deciding"));
        assert_eq!(rig.answer(&question), Verdict::Accepted);
        assert_eq!(rig.rulings(&job), [Some(ruling)]);

        let workers = workers(&rig.scheduler);
        let quarantined: Vec<&str> = workers.iter().filter(|w| w.quarantined).map(|w| &*w.id.0).collect();
        assert_eq!(quarantined, [faulty]);
        assert!(workers.iter().any(|w| w.quarantined && w.reason.contains("differs from that of two other workers")));
        assert!(rig.drained.contains(&WorkerId(faulty.into())), "{faulty} gets a drain message");
        let late = rig.given_to(faulty, &first).completed(first.delivery());
        assert_eq!(rig.complete(late), Verdict::Quarantined);

        // The quarantine survives a restart of the coordinator; another worker id gets work.
        rig.given.clear();
        rig.restart();
        rig.connect(faulty, 4);
        assert!(rig.given.is_empty(), "{faulty} gets no work");
        assert!(rig.waits_for(&job).contains("quarantined"));
        rig.connect("new", 1);
        rig.work_off();
        rig.assert_right(&job, 2, 2);
    }
}

#[test]
fn result_that_decides_and_completes_round_survives_restart() {
    // After the last of these rounds another phase follows.
    for last in [false, true] {
        let rounds = if last { 1 } else { 2 };
        let mut rig = Rig::new();
        let job = rig.submit("a", 2, rounds);
        rig.connect("a", 1);
        rig.connect("b", 1);
        let first = rig.take_of("a").unwrap();
        rig.answer(&first);
        let wrong = rig.given_to("b", &first).completed(first.wrong(0));
        assert_eq!(rig.complete(wrong), Verdict::Conflict);
        // A third worker delivers both tasks at once.
        let both = rig.early("c", &job, 0..2);
        rig.answer(&both);
        assert_eq!(
            (rig.rulings(&job).as_slice(), rig.stored(&job).rounds_sealed),
            ([Some(Ruling::Upheld)].as_slice(), 1)
        );
        rig.given.clear();
        rig.restart();
        rig.connect("d", 1);
        rig.work_off();
        rig.assert_right(&job, 2, rounds);
    }
}

#[test]
fn ruling_holds_after_restart_in_mid_round() {
    let (mut rig, job, _) = disputed("b");
    rig.given.clear();
    rig.restart();
    assert_eq!(rig.rulings(&job), [None], "an open dispute survives");
    rig.connect("c", 1);
    let question = rig.take_of("c").unwrap();
    rig.answer(&question);
    assert_eq!(rig.rulings(&job), [Some(Ruling::Corrected)]);
    assert_eq!(rig.stored(&job).rounds_sealed, 0);
    rig.given.clear();
    rig.restart();
    rig.connect("d", 1);
    rig.work_off();
    rig.assert_right(&job, 2, 2);
}

#[test]
fn arbiter_is_on_another_host_if_possible() {
    let (mut rig, job, _) = disputed("a");
    rig.pause(&job, true);
    rig.connect("c", 1);
    let elsewhere = Greeting { address: "10.0.0.2:1".to_owned(), ..greeting("z", 1) };
    rig.greet(elsewhere);
    rig.pause(&job, false);
    rig.commit_and_collect();
    let mut asked = rig.scheduler.leases.all.values().filter(|l| l.kind == lease::LeaseKind::Arbitration);
    assert_eq!(
        asked.next().map(|l| l.worker.to_string()).as_deref(),
        Some("z"),
        "\"c\" is on the host of the other two"
    );
}

#[test]
fn wrong_sealed_result_taints_its_job() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 3);
    rig.connect("faulty", 1);
    let first = rig.take().unwrap();
    rig.deliver_wrong(&first);
    let second = rig.take().unwrap();
    rig.answer(&second);
    let sealed = at_once(rig.store.digests(&job, 0)).unwrap();
    assert_eq!(rig.stored(&job).rounds_sealed, 1);

    // Another worker delivers the task late. A restart keeps the workers of the results.
    rig.given.clear();
    rig.restart();
    let late = rig.given_to("late", &first).completed(first.delivery());
    assert_eq!(rig.complete(late), Verdict::Conflict);
    assert_eq!(rig.rulings(&job), [None]);
    // Meanwhile the job continues, but no round is sealed.
    rig.connect("late", 1);
    rig.work_off();
    assert_eq!((rig.stored(&job).state, rig.stored(&job).rounds_sealed), (JobState::Running, 1));
    assert_eq!(rig.scheduler.round(&job).map(|(done, total)| done == total), Some(true));

    rig.connect("third", 1);
    let question = rig.take_of("third").unwrap();
    assert_eq!((question.range().round, question.range().first, question.range().count), (0, 0, 1));
    assert_eq!(rig.answer(&question), Verdict::Accepted);
    let record = rig.stored(&job);
    assert_eq!(record.state, JobState::Tainted);
    let bits = sealed[0].short();
    for part in ["task 0 of round 0", "sealed in round 0", &bits, "faulty", "evogait restart"] {
        assert!(record.reason.contains(part), "{part}: {}", record.reason);
    }
    assert_eq!(at_once(rig.store.digests(&job, 0)).unwrap(), sealed, "a sealed round does not change");
    assert!(rig.is_quarantined("faulty"), "a worker without connection can be quarantined");
}

#[test]
fn three_different_results_ask_a_fourth_worker() {
    let (mut rig, job, _) = disputed("a");
    rig.connect("c", 1);
    let question = rig.take_of("c").unwrap();
    assert_eq!(rig.complete(question.completed(question.wrong(5))), Verdict::Conflict);
    assert_eq!(rig.rulings(&job), [None]);
    rig.connect("d", 1);
    let question = rig.take_of("d").unwrap();
    rig.answer(&question);
    assert_eq!(rig.rulings(&job), [Some(Ruling::Upheld)]);
    assert_eq!(rig.quarantined().len(), 2);
}

#[test]
fn self_contradicting_worker_has_no_vote() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 3, 1);
    rig.connect("a", 1);
    let (given, second) = (rig.early("a", &job, 0..1), rig.early("a", &job, 1..2));
    rig.deliver_wrong(&given);
    rig.answer(&second);
    assert_eq!(rig.answer(&given), Verdict::Conflict);
    assert_eq!(rig.quarantined(), ["a"]);
    assert_eq!(rig.deliver_tasks("b", &job, 0..1, false), Verdict::Conflict);
    assert_eq!(rig.rulings(&job), [None, None], "only \"b\" votes, and the other result of \"a\" is disputed too");
    rig.given.clear();
    rig.connect("c", 1);
    rig.work_off();
    assert_eq!(rig.rulings(&job), [Some(Ruling::Corrected), Some(Ruling::Upheld)]);
    rig.assert_right(&job, 3, 1);
}

fn connect_at(rig: &mut Rig, id: &str, host: u8) {
    rig.greet(Greeting { address: format!("10.0.0.{host}:7"), ..greeting(id, 1) });
    rig.commit_and_collect();
}

/// The worker delivers results of its next assignment.
fn deliver_next(rig: &mut Rig, worker: &str, wrong: bool) {
    let question = rig.take_of(worker).expect("the worker has an assignment");
    let delivery = if wrong { question.wrong(0) } else { question.delivery() };
    rig.complete(question.completed(delivery));
}

fn is_arbiter(rig: &Rig, worker: &str) -> bool {
    rig.scheduler.leases.all.values().any(|l| l.kind == lease::LeaseKind::Arbitration && &*l.worker.0 == worker)
}

/// "bad" on one host and "good" on another deliver different results of a task, and no arbiter has decided.
fn two_hosts_differ() -> (Rig, JobId, Given) {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    connect_at(&mut rig, "bad", 1);
    let given = rig.take().unwrap();
    rig.deliver_first_task("bad", &given, true);
    connect_at(&mut rig, "good", 2);
    rig.deliver_first_task("good", &given, false);
    (rig, job, given)
}

#[test]
fn host_with_more_workers_has_no_majority() {
    let (mut rig, job, _) = two_hosts_differ();
    connect_at(&mut rig, "bad too", 1);
    assert!(is_arbiter(&rig, "bad too"), "no other worker can decide");
    deliver_next(&mut rig, "bad too", true);
    assert_eq!(rig.rulings(&job), [None], "one host against another");
    assert!(rig.quarantined().is_empty());

    connect_at(&mut rig, "good too", 2);
    assert!(is_arbiter(&rig, "good too"), "its host has only one claim");
    deliver_next(&mut rig, "good too", false);
    assert_eq!(rig.rulings(&job), [None]);
    let why = rig.waits_for(&job);
    let told = "waits for a worker on a third machine: two results of task 0 of round 0 differ";
    assert!(why.contains(told), "{why}");
    for (id, host) in [("bad again", 1), ("good again", 2)] {
        connect_at(&mut rig, id, host);
        assert!(!is_arbiter(&rig, id), "{id} is on a host with two claims");
    }
    connect_at(&mut rig, "third", 3);
    assert!(is_arbiter(&rig, "third"));
    deliver_next(&mut rig, "third", false);
    assert_eq!(rig.rulings(&job), [Some(Ruling::Corrected)]);
    let quarantined: Vec<String> = rig.quarantined();
    assert_eq!(quarantined, ["bad", "bad too"]);
}

#[test]
fn claim_of_unknown_host_does_not_decide() {
    let (mut rig, job, given) = two_hosts_differ();
    rig.deliver_first_task("never connected", &given, true);
    assert_eq!(rig.rulings(&job), [None], "the worker may be on the first host");
    connect_at(&mut rig, "third", 3);
    deliver_next(&mut rig, "third", false);
    assert_eq!(rig.rulings(&job), [Some(Ruling::Corrected)]);
}

#[test]
fn same_host_can_refute_its_own_worker() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    for (id, host) in [("bad", 1), ("good", 2), ("beside it", 1)] {
        connect_at(&mut rig, id, host);
    }
    let given = rig.take().unwrap();
    rig.deliver_first_task("bad", &given, true);
    rig.deliver_first_task("good", &given, false);
    rig.deliver_first_task("beside it", &given, false);
    assert_eq!(rig.rulings(&job), [Some(Ruling::Corrected)], "two hosts agree");
    assert!(rig.is_quarantined("bad"));
}

#[test]
fn self_contradicting_worker_counts_for_no_host() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    connect_at(&mut rig, "a", 1);
    let given = rig.take().unwrap();
    rig.deliver_first_task("a", &given, true);
    rig.deliver_first_task("a", &given, false);
    for (id, host) in [("b", 2), ("c", 2)] {
        connect_at(&mut rig, id, host);
        rig.deliver_first_task(id, &given, false);
    }
    assert_eq!(rig.rulings(&job), [Some(Ruling::Corrected)]);
}

#[test]
fn workers_on_single_host_decide_by_majority() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    for id in ["a", "b", "c"] {
        connect_at(&mut rig, id, 1);
    }
    let given = rig.take().unwrap();
    rig.deliver_first_task("a", &given, true);
    rig.deliver_first_task("b", &given, false);
    assert_eq!(rig.rulings(&job), [None]);
    rig.deliver_first_task("c", &given, false);
    assert_eq!(rig.rulings(&job), [Some(Ruling::Corrected)]);
}

/// A result of host 1, in a round that is sealed or not; then the coordinator restarts.
fn result_before_restart(sealed: bool, wrong: bool) -> (Rig, JobId, Given) {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 3);
    connect_at(&mut rig, "first", 1);
    let given = rig.take().unwrap();
    rig.deliver_first_task("first", &given, wrong);
    if sealed {
        let second = rig.take().unwrap();
        rig.answer(&second);
    }
    assert_eq!(rig.stored(&job).rounds_sealed, u32::from(sealed));
    rig.given.clear();
    rig.restart();
    (rig, job, given)
}

#[test]
fn hosts_of_results_survive_restart() {
    for sealed in [false, true] {
        let (mut rig, job, given) = result_before_restart(sealed, true);
        for (id, host) in [("good", 2), ("bad too", 1)] {
            connect_at(&mut rig, id, host);
        }
        rig.deliver_first_task("good", &given, false);
        rig.deliver_first_task("bad too", &given, true);
        assert_eq!(rig.rulings(&job), [None], "workers on one host must not decide; sealed: {sealed}");

        let (mut rig, job, given) = result_before_restart(sealed, false);
        for (id, host) in [("bad", 2), ("good", 3)] {
            connect_at(&mut rig, id, host);
        }
        rig.deliver_first_task("bad", &given, true);
        assert_eq!(rig.rulings(&job), [None]);
        rig.deliver_first_task("good", &given, false);
        assert_eq!(rig.rulings(&job), [Some(Ruling::Upheld)], "two hosts decide; sealed: {sealed}");
    }
}
