//! Tests of time limits: stragglers, stuck leases, machines that shut down.

use super::*;

/// Delivers the right results with a measured cost of 1 s per task.
fn deliver_in_one_second(rig: &mut Rig, given: &Given) -> Verdict {
    let compute = Duration::from_secs(1) * given.range().count;
    rig.complete(Completed { compute, ..given.completed(given.delivery()) })
}

/// A job of two tasks, with the second on a slow worker; worker "fast" has a free slot.
fn job_with_straggler() -> (Rig, JobId, Given, BTreeMap<&'static str, SessionId>) {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 1);
    let mut sessions = BTreeMap::new();
    for id in ["fast", "slow"] {
        sessions.insert(id, rig.connect(id, 1));
    }
    let fast = rig.take_of("fast").unwrap();
    assert_eq!(deliver_in_one_second(&mut rig, &fast), Verdict::Accepted);
    let slow = rig.given[0].clone();
    (rig, job, slow, sessions)
}

#[test]
fn straggler_gets_one_copy_and_first_result_wins() {
    for first in ["fast", "slow"] {
        let (mut rig, job, slow, sessions) = job_with_straggler();
        rig.now.since_start += Duration::from_millis(1900);
        rig.heartbeat("fast", sessions["fast"], 0);
        assert!(rig.take_of("fast").is_none(), "no copy before twice the expected time");
        rig.now.since_start += Duration::from_millis(200);
        rig.heartbeat("slow", sessions["slow"], 1);
        assert_eq!(leased(&rig, &job), 1, "no copy on the same worker");
        rig.heartbeat("fast", sessions["fast"], 0);
        let copy = rig.take_of("fast").expect("the straggler gets a copy");
        assert_eq!(copy.range(), slow.range());
        let why = rig.waits_for(&job);
        assert!(why.contains("computed twice"), "{why}");
        rig.connect("idle", 4);
        rig.advance(Duration::from_secs(1));
        assert!(rig.take_of("idle").is_none(), "a straggler gets one copy");

        let (winner, loser) = if first == "fast" { (&copy, &slow) } else { (&slow, &copy) };
        assert_eq!(rig.answer(winner), Verdict::Accepted);
        assert!(rig.cancelled.contains(&loser.id()), "the other lease is revoked");
        assert_eq!(rig.answer(loser), Verdict::Duplicate);
        rig.given.retain(|g| g.id() != slow.id());
        rig.work_off();
        rig.assert_right(&job, 2, 1);
    }
}

#[test]
fn copy_takes_over_from_drained_original() {
    let (mut rig, job, slow, sessions) = job_with_straggler();
    rig.now.since_start += Duration::from_secs(3);
    rig.heartbeat("fast", sessions["fast"], 0);
    let copy = rig.take_of("fast").expect("a copy");
    on_drain(&mut rig.scheduler, rig.now, &slow.worker, sessions["slow"], &[]);
    rig.commit_and_collect();
    assert_eq!(leased(&rig, &job), 1, "the copy continues, with no third lease");
    assert_eq!(rig.scheduler.jobs.active[&job].round.pending(), 0);
    assert_eq!(rig.answer(&copy), Verdict::Accepted);

    let (mut rig, job, _, sessions) = job_with_straggler();
    rig.now.since_start += Duration::from_secs(3);
    rig.heartbeat("fast", sessions["fast"], 0);
    rig.drain("fast", sessions["fast"], &[]);
    rig.commit_and_collect();
    assert_eq!(
        (leased(&rig, &job), rig.scheduler.leases.copies.len()),
        (1, 0),
        "the original continues without a copy"
    );
    rig.drain("slow", sessions["slow"], &[]);
    rig.commit_and_collect();
    assert_eq!(rig.scheduler.jobs.active[&job].round.pending(), 1);
}

#[test]
fn stuck_lease_is_revoked_despite_heartbeats() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 1);
    let session = rig.connect("stuck", 1);
    let other = rig.connect("other", 1);
    let (stuck, fine) = (rig.given[0].clone(), rig.given[1].clone());
    let mut beats = 0;
    let mut beat = |rig: &mut Rig, progress: u64| {
        beats += 1;
        rig.now.since_start += LEASE / 2;
        rig.heartbeat("stuck", session, progress);
        rig.heartbeat("other", other, beats);
    };
    // While the count grows the lease stays. Then it has two lease times.
    for progress in 1..8 {
        beat(&mut rig, progress);
    }
    for _ in 0..3 {
        beat(&mut rig, 7);
        assert!(!rig.cancelled.contains(&stuck.id()));
    }
    beat(&mut rig, 7);
    assert!(rig.cancelled.contains(&stuck.id()), "the stuck worker gets the revocation");
    assert!(rig.take_of("stuck").is_none(), "another worker gets the task first");
    rig.given.retain(|g| g.id() != fine.id());
    assert_eq!(deliver_in_one_second(&mut rig, &fine), Verdict::Accepted);
    let again = rig.take_of("other").expect("another worker gets the task");
    assert_eq!(again.range(), stuck.range());
    assert_eq!(rig.stored(&job).state, JobState::Running);
}

#[test]
fn queued_or_unreported_lease_is_not_revoked() {
    let mut rig = Rig::new();
    rig.submit("a", 2000, 1);
    let session = rig.connect("w", 1);
    let first = rig.take().unwrap();
    let compute = Duration::from_millis(2) * first.range().count;
    let delivery = first.delivery();
    rig.complete(Completed { compute, ..first.completed(delivery) });
    assert_eq!(rig.scheduler.fleet.workers.values().next().unwrap().held.len(), 2, "one in advance");
    let ids: Vec<_> = rig.given.iter().map(|g| g.id()).collect();
    for beat in 0..10 {
        rig.now.since_start += LEASE / 2;
        // The first lease makes progress, the second waits behind it.
        assert!(rig.beat("w", session, &ids, &[beat + 1, 0]));
    }
    for _ in 0..10 {
        rig.now.since_start += LEASE / 2;
        assert!(rig.beat("w", session, &ids, &[]));
    }
    rig.commit_and_collect();
    assert!(rig.cancelled.is_empty());
}

#[test]
fn undelivered_lease_is_assigned_again() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 1, 1);
    let session = rig.connect("w", 1);
    let lost = rig.take().unwrap();
    // The assignment may be on its way for a while.
    for _ in 0..4 {
        rig.now.since_start += LEASE / 5;
        assert!(rig.beat("w", session, &[], &[]));
        rig.commit_and_collect();
    }
    let again = rig.take().expect("the task is assigned again");
    assert!(again.id() != lost.id() && again.range() == lost.range());
    assert!(rig.stored(&job).charges.is_empty(), "a lease that never ran charges no task");
    // The first assignment arrived after all: its late result counts.
    assert_eq!(deliver_in_one_second(&mut rig, &lost), Verdict::Accepted);
}

#[test]
fn lease_behind_hung_slots_is_revoked_without_charge() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 1);
    let session = rig.connect("lost", 2);
    // Both slots still run cancelled leases. The new leases stay queued, and nothing crashes.
    for _ in 0..6 {
        rig.now.since_start += LEASE / 2;
        rig.heartbeat("lost", session, 0);
    }
    assert_eq!(rig.cancelled.len(), 2, "both leases are revoked");
    assert!(rig.stored(&job).charges.is_empty(), "{:?}", rig.stored(&job).charges);
    rig.connect("other", 2);
    rig.work_off();
    rig.assert_right(&job, 2, 1);
}

#[test]
fn worker_with_own_stuck_timeout_gets_more_time() {
    let mut rig = Rig::new();
    rig.submit("a", 1, 1);
    let stuck_after = Some(10 * LEASE);
    let session = rig.greet(Greeting { stuck_after, ..greeting("slow", 1) }).session;
    rig.commit_and_collect();
    for beat in 0..25 {
        rig.now.since_start += LEASE / 2;
        rig.heartbeat("slow", session, 1);
        assert_eq!(rig.cancelled.len(), usize::from(beat >= 24), "after {} leases", f64::from(beat) / 2.0);
    }
}

#[test]
fn repeatedly_stuck_worker_gets_no_work_until_reconnect() {
    let mut rig = Rig::new();
    rig.submit("a", 50, 1);
    let session = rig.connect("stuck", 1);
    for _ in 0..stuck::MOST_TIMES {
        assert!(rig.scheduler.fleet.workers.values().next().unwrap().takes_work());
        for _ in 0..6 {
            rig.now.since_start += LEASE / 2;
            rig.heartbeat("stuck", session, 1);
        }
        rig.advance(LEASE / 2);
    }
    let told = workers(&rig.scheduler).remove(0);
    assert!(told.reason.contains("stuck") && told.busy == 0, "{told:?}");
    rig.given.clear();
    rig.connect("stuck", 1);
    assert!(rig.take().is_some());
}

#[test]
fn leaving_worker_gets_only_tasks_that_fit() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 100, 1);
    rig.connect("w", 1);
    let first = rig.take().unwrap();
    deliver_in_one_second(&mut rig, &first);
    let seconds = |s| Some(Duration::from_secs(s));
    let connect = |rig: &mut Rig, id: &str, time_left| {
        rig.greet(Greeting { time_left, ..greeting(id, 1) });
        rig.commit_and_collect();
        rig.take_of(id).map(|g| g.range().count)
    };
    // The worker is drained 4 s before its machine shuts down, so 3 of its 7 s remain, and a range of 5 tasks would
    // take 5 s.
    assert_eq!(connect(&mut rig, "short", seconds(7)), Some(3));
    assert_eq!(connect(&mut rig, "shorter", seconds(4)), None);
    assert!(connect(&mut rig, "long", seconds(100)).is_some_and(|count| count > 3));
    assert_eq!(rig.drained, [WorkerId("shorter".into())], "a worker without time for any task is drained at once");
    // "short" is drained in time, and its lease ends.
    assert_eq!(rig.scheduler.next_deadline(), Some(rig.now.since_start + Duration::from_secs(3)));
    let before = leased(&rig, &job);
    rig.advance(Duration::from_secs(3));
    assert_eq!(rig.drained.last(), Some(&WorkerId("short".into())));
    assert_eq!(leased(&rig, &job), before - 1);
    let why: Vec<String> = workers(&rig.scheduler).into_iter().map(|w| format!("{} {}", w.id, w.reason)).collect();
    assert!(why.contains(&"short draining".to_owned()), "{why:?}");
}
