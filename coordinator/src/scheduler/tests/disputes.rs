//! Laws about results that differ.

use super::*;
use crate::record::Event;

/// A job whose first task was, committed by "a" and disputed by "b"; a third worker has not come yet.
fn disputed(honest: &str) -> (Rig, JobId, Given) {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    rig.connect("a", 1);
    let given = rig.take().unwrap();
    rig.connect("b", 1);
    let by = |who: &str| if who == honest { given.delivery() } else { given.wrong(0) };
    assert_eq!(rig.complete(given.completed(by("a"))), Verdict::Accepted);
    let other = rig.given_to("b", &given).completed(by("b"));
    assert_eq!(rig.complete(other), Verdict::Conflict);
    (rig, job, given)
}

#[test]
fn disputed_round_is_not_sealed_and_says_why() {
    let (mut rig, job, _) = disputed("a");
    rig.work_off();
    assert_eq!(rig.scheduler.round(&job), Some((2, 2)), "all is done");
    assert_eq!(rig.stored(&job).rounds_sealed, 0, "and nothing is sealed");
    let why = rig.waits_for(&job);
    assert!(why.contains("waits for another worker: two results of task 0 of round 0 differ"), "{why}");
    assert_eq!(rig.rulings(&job), [None]);
    let events = at_once(rig.store.events(&job, 0, 100));
    let told = events.iter().filter(|e| matches!(e.event.event, Event::Dispute(_))).count();
    assert_eq!(told, 1, "clients that watch are told");
}

#[test]
fn third_worker_decides_and_minority_is_quarantined() {
    for (honest, ruling) in [("a", Ruling::Upheld), ("b", Ruling::Corrected)] {
        let liar = if honest == "a" { "b" } else { "a" };
        let (mut rig, job, first) = disputed(honest);
        rig.connect("c", 1);
        let question = rig.take_of("c").expect("the third is asked");
        assert_eq!(question.range(), first.range());
        assert!(rig.waits_for(&job).contains("another worker is deciding"));
        assert_eq!(rig.answer(&question), Verdict::Accepted);
        assert_eq!(rig.rulings(&job), [Some(ruling)]);

        let workers = workers(&rig.scheduler);
        let quarantined: Vec<&str> = workers.iter().filter(|w| w.quarantined).map(|w| &*w.id.0).collect();
        assert_eq!(quarantined, [liar]);
        assert!(workers.iter().any(|w| w.quarantined && w.reason.contains("differs from that of two other workers")));
        assert!(rig.drained.contains(&WorkerId(liar.into())), "it is told");
        let late = rig.given_to(liar, &first).completed(first.delivery());
        assert_eq!(rig.complete(late), Verdict::Quarantined);

        // It stays so, whatever starts again; under another id it may come back.
        rig.given.clear();
        rig.restart();
        rig.connect(liar, 4);
        assert!(rig.given.is_empty(), "nothing for {liar}");
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
        let lie = rig.given_to("b", &first).completed(first.wrong(0));
        assert_eq!(rig.complete(lie), Verdict::Conflict);
        // A third one, cut off since before, brings both tasks at once.
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
    rig.settle();
    let mut asked = rig.scheduler.leases.all.values().filter(|l| l.kind == lease::Kind::Arbitration);
    assert_eq!(asked.next().map(|l| l.worker.to_string()).as_deref(), Some("z"), "\"c\" is where the others are");
}

#[test]
fn sealed_result_that_loses_taints_its_job() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 3);
    rig.connect("liar", 1);
    let first = rig.take().unwrap();
    rig.lie(&first);
    let second = rig.take().unwrap();
    rig.answer(&second);
    let sealed = at_once(rig.store.digests(&job, 0)).unwrap();
    assert_eq!(rig.stored(&job).rounds_sealed, 1);

    // A worker that had it before delivers late; the finders are known after a restart too.
    rig.given.clear();
    rig.restart();
    let late = rig.given_to("late", &first).completed(first.delivery());
    assert_eq!(rig.complete(late), Verdict::Conflict);
    assert_eq!(rig.rulings(&job), [None]);
    // Meanwhile the job goes on, but no round is sealed.
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
    for part in ["task 0 of round 0", "sealed in round 0", &bits, "liar", "evogait restart"] {
        assert!(record.reason.contains(part), "{part}: {}", record.reason);
    }
    assert_eq!(at_once(rig.store.digests(&job, 0)).unwrap(), sealed, "what is sealed stays");
    assert!(rig.is_quarantined("liar"), "though it is not connected");
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
    rig.lie(&given);
    rig.answer(&second);
    assert_eq!(rig.answer(&given), Verdict::Conflict);
    assert_eq!(rig.quarantined(), ["a"]);
    assert_eq!(rig.says("b", &job, 0..1, false), Verdict::Conflict);
    assert_eq!(rig.rulings(&job), [None, None], "one claim against none; what else it found is in doubt");
    rig.given.clear();
    rig.connect("c", 1);
    rig.work_off();
    assert_eq!(rig.rulings(&job), [Some(Ruling::Corrected), Some(Ruling::Upheld)]);
    rig.assert_right(&job, 3, 1);
}

fn connect_at(rig: &mut Rig, id: &str, host: u8) {
    rig.greet(Greeting { address: format!("10.0.0.{host}:7"), ..greeting(id, 1) });
    rig.settle();
}

/// A worker answers what it was given.
fn answers(rig: &mut Rig, who: &str, wrong: bool) {
    let question = rig.take_of(who).expect("it has work");
    let delivery = if wrong { question.wrong(0) } else { question.delivery() };
    rig.complete(question.completed(delivery));
}

fn is_asked(rig: &Rig, worker: &str) -> bool {
    rig.scheduler.leases.all.values().any(|l| l.kind == lease::Kind::Arbitration && &*l.worker.0 == worker)
}

/// "bad" on one host and "good" on another differ about a task, and no third worker has decided.
fn two_machines_differ() -> (Rig, JobId, Given) {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    connect_at(&mut rig, "bad", 1);
    let given = rig.take().unwrap();
    rig.says_first("bad", &given, true);
    connect_at(&mut rig, "good", 2);
    rig.says_first("good", &given, false);
    (rig, job, given)
}

#[test]
fn host_with_more_workers_has_no_majority() {
    let (mut rig, job, _) = two_machines_differ();
    connect_at(&mut rig, "bad too", 1);
    assert!(is_asked(&rig, "bad too"), "there is no other worker");
    answers(&mut rig, "bad too", true);
    assert_eq!(rig.rulings(&job), [None], "one machine against another");
    assert!(rig.quarantined().is_empty());

    connect_at(&mut rig, "good too", 2);
    assert!(is_asked(&rig, "good too"), "its machine can still be confirmed");
    answers(&mut rig, "good too", false);
    assert_eq!(rig.rulings(&job), [None]);
    let why = rig.waits_for(&job);
    let told = "waits for a worker on a third machine: two results of task 0 of round 0 differ";
    assert!(why.contains(told), "{why}");
    for (id, host) in [("bad again", 1), ("good again", 2)] {
        connect_at(&mut rig, id, host);
        assert!(!is_asked(&rig, id), "{id} would say nothing new");
    }
    connect_at(&mut rig, "third", 3);
    assert!(is_asked(&rig, "third"));
    answers(&mut rig, "third", false);
    assert_eq!(rig.rulings(&job), [Some(Ruling::Corrected)]);
    let quarantined: Vec<String> = rig.quarantined();
    assert_eq!(quarantined, ["bad", "bad too"]);
}

#[test]
fn claim_of_unknown_host_does_not_decide() {
    let (mut rig, job, given) = two_machines_differ();
    rig.says_first("never connected", &given, true);
    assert_eq!(rig.rulings(&job), [None], "it may be on the first one");
    connect_at(&mut rig, "third", 3);
    answers(&mut rig, "third", false);
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
    rig.says_first("bad", &given, true);
    rig.says_first("good", &given, false);
    rig.says_first("beside it", &given, false);
    assert_eq!(rig.rulings(&job), [Some(Ruling::Corrected)], "two machines agree");
    assert!(rig.is_quarantined("bad"));
}

#[test]
fn self_contradicting_worker_counts_for_no_host() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    connect_at(&mut rig, "a", 1);
    let given = rig.take().unwrap();
    rig.says_first("a", &given, true);
    rig.says_first("a", &given, false);
    for (id, host) in [("b", 2), ("c", 2)] {
        connect_at(&mut rig, id, host);
        rig.says_first(id, &given, false);
    }
    assert_eq!(rig.rulings(&job), [Some(Ruling::Corrected)]);
}

#[test]
fn workers_on_one_host_decide_alone() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    for id in ["a", "b", "c"] {
        connect_at(&mut rig, id, 1);
    }
    let given = rig.take().unwrap();
    rig.says_first("a", &given, true);
    rig.says_first("b", &given, false);
    assert_eq!(rig.rulings(&job), [None]);
    rig.says_first("c", &given, false);
    assert_eq!(rig.rulings(&job), [Some(Ruling::Corrected)]);
}

/// A result of host 1, its round sealed or not, and a coordinator that was restarted since.
fn found_before_a_restart(sealed: bool, wrong: bool) -> (Rig, JobId, Given) {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 3);
    connect_at(&mut rig, "first", 1);
    let given = rig.take().unwrap();
    rig.says_first("first", &given, wrong);
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
        let (mut rig, job, given) = found_before_a_restart(sealed, true);
        for (id, host) in [("good", 2), ("bad too", 1)] {
            connect_at(&mut rig, id, host);
        }
        rig.says_first("good", &given, false);
        rig.says_first("bad too", &given, true);
        assert_eq!(rig.rulings(&job), [None], "one machine has no more weight; sealed: {sealed}");

        let (mut rig, job, given) = found_before_a_restart(sealed, false);
        for (id, host) in [("bad", 2), ("good", 3)] {
            connect_at(&mut rig, id, host);
        }
        rig.says_first("bad", &given, true);
        assert_eq!(rig.rulings(&job), [None]);
        rig.says_first("good", &given, false);
        assert_eq!(rig.rulings(&job), [Some(Ruling::Upheld)], "and no less; sealed: {sealed}");
    }
}
