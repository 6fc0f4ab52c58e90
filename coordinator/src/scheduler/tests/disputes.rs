//! The promises about results that differ.

use super::*;
use crate::record::{Ruling, Source};

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
fn a_result_that_decides_and_completes_a_round_leaves_nothing_behind_that_a_restart_stumbles_over() {
    // In the last generation another kind of round follows.
    for last in [false, true] {
        let generations = if last { 1 } else { 2 };
        let mut rig = Rig::new();
        let job = rig.submit("a", 2, generations);
        rig.connect("a", 1);
        rig.connect("b", 1);
        let first = rig.take_of("a").unwrap();
        rig.complete(first.completed(first.delivery()));
        let lie = Completed { worker: WorkerId("b".into()), ..first.completed(first.wrong(0)) };
        assert_eq!(rig.complete(lie), Verdict::Conflict);
        // A third one, cut off since before, brings both candidates at once.
        let genomes: Arc<[Genome]> = Fake::new(2).ask().into();
        let task = Task::Evaluate { range: Range { round: 0, first: 0, count: 2 }, genomes, base: 0 };
        let both = Given { worker: WorkerId("c".into()), task, ..first };
        rig.complete(both.completed(both.delivery()));
        assert_eq!(
            (rulings(&rig, &job).as_slice(), rig.stored(&job).generations_done),
            ([Some(Ruling::Upheld)].as_slice(), 1)
        );
        rig.given.clear();
        rig.restart(|_| 2);
        rig.connect("d", 1);
        rig.work_off();
        assert_eq!(rig.stored(&job).result_digest, Some(expected_digest("a", 2, generations)));
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
    assert_eq!(
        rulings(&rig, &job),
        [Some(Ruling::Corrected), Some(Ruling::Upheld)],
        "what else it found is asked again"
    );
    assert_eq!(rig.stored(&job).result_digest, Some(expected_digest("a", 2, 1)));
}

fn connect_at(rig: &mut Rig, id: &str, host: u8) {
    rig.scheduler.connect(rig.now, Greeting { address: format!("10.0.0.{host}:7"), ..greeting(id, 1) });
    rig.settle();
}

/// A worker answers what it was given.
fn answers(rig: &mut Rig, who: &str, wrong: bool) {
    let question = rig.take_of(who).expect("it has work");
    let delivery = if wrong { question.wrong(0) } else { question.delivery() };
    rig.complete(question.completed(delivery));
}

/// A worker says something about the first task of what another one was given, without being asked.
fn says(rig: &mut Rig, who: &str, given: &Given, wrong: bool) -> Verdict {
    let first = given.first();
    let delivery = if wrong { first.wrong(0) } else { first.delivery() };
    rig.complete(Completed { worker: WorkerId(who.into()), ..first.completed(delivery) })
}

fn is_asked(rig: &Rig, worker: &str) -> bool {
    rig.scheduler.leases.values().any(|l| l.kind == lease::Kind::Decides && &*l.worker.0 == worker)
}

/// What "bad" on one machine found and "good" on another one did not; nobody has decided.
fn two_machines_differ() -> (Rig, JobId, Given) {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    connect_at(&mut rig, "bad", 1);
    let given = rig.take().unwrap();
    says(&mut rig, "bad", &given, true);
    connect_at(&mut rig, "good", 2);
    says(&mut rig, "good", &given, false);
    (rig, job, given)
}

#[test]
fn one_machine_does_not_outvote_another_with_the_number_of_its_workers() {
    let (mut rig, job, _) = two_machines_differ();
    connect_at(&mut rig, "bad too", 1);
    assert!(is_asked(&rig, "bad too"), "there is nobody else");
    answers(&mut rig, "bad too", true);
    assert_eq!(rulings(&rig, &job), [None], "one machine against another");
    assert!(rig.scheduler.quarantined.is_empty());

    connect_at(&mut rig, "good too", 2);
    assert!(is_asked(&rig, "good too"), "its machine can still be confirmed");
    answers(&mut rig, "good too", false);
    assert_eq!(rulings(&rig, &job), [None]);
    let why = rig.scheduler.waits_for(&job).unwrap();
    let told = "waits for a worker on a third machine: two results of candidate 0 of generation 0 differ";
    assert!(why.contains(told), "{why}");
    for (id, host) in [("bad again", 1), ("good again", 2)] {
        connect_at(&mut rig, id, host);
        assert!(!is_asked(&rig, id), "{id} would say nothing new");
    }
    connect_at(&mut rig, "third", 3);
    assert!(is_asked(&rig, "third"));
    answers(&mut rig, "third", false);
    assert_eq!(rulings(&rig, &job), [Some(Ruling::Corrected)]);
    let quarantined: Vec<String> = rig.scheduler.quarantined.keys().map(WorkerId::to_string).collect();
    assert_eq!(quarantined, ["bad", "bad too"]);
}

#[test]
fn a_result_from_nobody_knows_where_does_not_decide_between_two_machines() {
    let (mut rig, job, given) = two_machines_differ();
    says(&mut rig, "never connected", &given, true);
    assert_eq!(rulings(&rig, &job), [None], "it may be on the first one");
    connect_at(&mut rig, "third", 3);
    answers(&mut rig, "third", false);
    assert_eq!(rulings(&rig, &job), [Some(Ruling::Corrected)]);
}

#[test]
fn another_worker_on_the_same_machine_can_show_that_the_first_one_was_wrong() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    for (id, host) in [("bad", 1), ("good", 2), ("beside it", 1)] {
        connect_at(&mut rig, id, host);
    }
    let given = rig.take().unwrap();
    says(&mut rig, "bad", &given, true);
    says(&mut rig, "good", &given, false);
    says(&mut rig, "beside it", &given, false);
    assert_eq!(rulings(&rig, &job), [Some(Ruling::Corrected)], "two machines agree");
    assert!(rig.scheduler.quarantined.contains_key(&WorkerId("bad".into())));
}

#[test]
fn a_worker_that_contradicts_itself_speaks_for_no_machine() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    connect_at(&mut rig, "a", 1);
    let given = rig.take().unwrap();
    says(&mut rig, "a", &given, true);
    says(&mut rig, "a", &given, false);
    for (id, host) in [("b", 2), ("c", 2)] {
        connect_at(&mut rig, id, host);
        says(&mut rig, id, &given, false);
    }
    assert_eq!(rulings(&rig, &job), [Some(Ruling::Corrected)]);
}

#[test]
fn workers_that_are_all_on_one_machine_decide_among_themselves() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    for id in ["a", "b", "c"] {
        connect_at(&mut rig, id, 1);
    }
    let given = rig.take().unwrap();
    says(&mut rig, "a", &given, true);
    says(&mut rig, "b", &given, false);
    assert_eq!(rulings(&rig, &job), [None]);
    says(&mut rig, "c", &given, false);
    assert_eq!(rulings(&rig, &job), [Some(Ruling::Corrected)]);
}

/// A result of machine 1, its generation sealed or not, and a coordinator that was started again since.
fn found_before_a_restart(sealed: bool, wrong: bool) -> (Rig, JobId, Given) {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 3);
    connect_at(&mut rig, "first", 1);
    let given = rig.take().unwrap();
    says(&mut rig, "first", &given, wrong);
    if sealed {
        let second = rig.take().unwrap();
        rig.complete(second.completed(second.delivery()));
    }
    assert_eq!(rig.stored(&job).generations_done, u32::from(sealed));
    rig.given.clear();
    rig.restart(|_| 2);
    (rig, job, given)
}

#[test]
fn it_is_known_after_a_restart_on_which_machine_something_was_found() {
    for sealed in [false, true] {
        let (mut rig, job, given) = found_before_a_restart(sealed, true);
        for (id, host) in [("good", 2), ("bad too", 1)] {
            connect_at(&mut rig, id, host);
        }
        says(&mut rig, "good", &given, false);
        says(&mut rig, "bad too", &given, true);
        assert_eq!(rulings(&rig, &job), [None], "one machine has no more weight; sealed: {sealed}");

        let (mut rig, job, given) = found_before_a_restart(sealed, false);
        for (id, host) in [("bad", 2), ("good", 3)] {
            connect_at(&mut rig, id, host);
        }
        says(&mut rig, "bad", &given, true);
        assert_eq!(rulings(&rig, &job), [None]);
        says(&mut rig, "good", &given, false);
        assert_eq!(rulings(&rig, &job), [Some(Ruling::Upheld)], "and no less; sealed: {sealed}");
    }
}

/// A job in its last generation, of which the first result was wrong, and what "liar" was given for it.
fn deceived_long_ago() -> (Rig, JobId, Given) {
    let mut rig = Rig::new();
    let job = rig.submit("a", 3, 4);
    rig.connect("liar", 1);
    let first = rig.take().unwrap();
    rig.complete(first.completed(first.wrong(0)));
    while rig.stored(&job).generations_done < 3 {
        let given = rig.take().unwrap();
        rig.complete(given.completed(given.delivery()));
    }
    (rig, job, first)
}

#[test]
fn a_late_result_is_compared_however_long_ago_its_generation_was_sealed() {
    for restarts in [false, true] {
        let (mut rig, job, first) = deceived_long_ago();
        if restarts {
            rig.given.clear();
            rig.restart(|_| 3);
        }
        let before = rig.stored(&job);
        assert_eq!(says(&mut rig, "liar", &first, true), Verdict::Duplicate);
        assert_eq!(rig.stored(&job), before, "the same bits change nothing");
        assert_eq!(says(&mut rig, "late", &first, false), Verdict::Conflict);
        let record = rig.stored(&job);
        assert_eq!((record.disputes[0].round, record.disputes[0].ruling), (0, None));
        assert!(record.disputes[0].claims[0].source.worker.is_empty(), "who said so is not known any more");
        assert!(rig.scheduler.waits_for(&job).is_some_and(|w| w.contains("candidate 0 of generation 0 differ")));
        assert_eq!(says(&mut rig, "late", &first, false), Verdict::Conflict, "the same once more");
        assert_eq!(rig.stored(&job).disputes[0].claims.len(), 2);
        rig.connect("third", 1);
        let question = rig.take_of("third").unwrap();
        assert_eq!((question.range().round, question.range().first, question.range().count), (0, 0, 1));
        rig.complete(question.completed(question.delivery()));
        assert_eq!(rig.stored(&job).state, JobState::Tainted);
        let again = rig.submit_again(&job, 0);
        rig.work_off();
        assert_eq!(rig.stored(&again).result_digest, Some(expected_digest("a", 3, 4)));
        assert_eq!(says(&mut rig, "late", &first, false), Verdict::Obsolete, "the job has ended");
    }
}

#[test]
fn a_late_lie_about_a_generation_long_sealed_is_found_out() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 3, 4);
    rig.connect("w", 1);
    let mut second = None;
    while rig.stored(&job).generations_done < 3 {
        let given = rig.take().unwrap();
        if given.range().round == 1 {
            second.get_or_insert_with(|| given.clone());
        }
        rig.complete(given.completed(given.delivery()));
    }
    let second = second.unwrap();
    assert_eq!(says(&mut rig, "liar", &second, true), Verdict::Conflict);
    rig.connect("third", 1);
    rig.work_off();
    let record = rig.stored(&job);
    assert_eq!(rulings(&rig, &job), [Some(Ruling::Upheld)]);
    assert_eq!((record.state, record.result_digest), (JobState::Succeeded, Some(expected_digest("a", 3, 4))));
    assert!(rig.scheduler.quarantined.contains_key(&WorkerId("liar".into())));
}

#[test]
fn whoever_found_what_was_sealed_long_ago_may_be_who_says_so_again() {
    let (mut rig, job, first) = deceived_long_ago();
    assert_eq!(says(&mut rig, "good", &first, false), Verdict::Conflict);
    answers(&mut rig, "liar", false);
    assert!(is_asked(&rig, "liar"), "nobody knows that it was this one");
    answers(&mut rig, "liar", true);
    assert_eq!(rulings(&rig, &job), [None], "its word, once more");
    rig.connect("third", 1);
    answers(&mut rig, "third", false);
    assert_eq!(rig.stored(&job).state, JobState::Tainted);
    let quarantined: Vec<String> = rig.scheduler.quarantined.keys().map(WorkerId::to_string).collect();
    assert_eq!(quarantined, ["liar"]);
}

#[test]
fn nothing_is_compared_for_the_quarantined_or_for_a_job_that_ended_meanwhile() {
    let (mut rig, job, first) = deceived_long_ago();
    let late = Completed { worker: WorkerId("late".into()), ..first.completed(first.delivery()) };
    assert_eq!(rig.scheduler.complete(rig.now, late.clone()), Verdict::Older);
    let source = Source { worker: "late".into(), name: "".into(), host: "".into() };
    rig.scheduler.quarantine(rig.now, &source, "it is a test");
    rig.settle();
    assert_eq!(rig.compare(late.clone()), Verdict::Quarantined);
    assert_eq!(rig.scheduler.complete(rig.now, late.clone()), Verdict::Quarantined, "without a look at the store");
    rig.scheduler.cancel(rig.now, &job);
    rig.settle();
    let other = Completed { worker: WorkerId("other".into()), ..late };
    assert_eq!(rig.compare(other), Verdict::Obsolete);
    assert_eq!(rulings(&rig, &job), []);
}
