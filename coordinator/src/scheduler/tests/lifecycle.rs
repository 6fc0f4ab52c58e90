//! Tests of the course of a job and of its leases.

use super::*;

#[test]
fn job_runs_from_submission_to_artefacts() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 20, 3);
    assert_eq!(rig.stored(&job).state, JobState::Queued);
    assert!(rig.waits_for(&job).contains("none is connected"));
    rig.connect("w", 2);
    assert_eq!(rig.stored(&job).state, JobState::Running);
    assert_eq!(waits_for(&rig.scheduler, &job), None);
    rig.work_off();
    let record = rig.stored(&job);
    assert_eq!(record.state, JobState::Succeeded);
    assert_eq!(record.result_digest, Some(expected_digest("a", 20, 3)));
    assert_eq!((record.rounds_sealed, record.rounds_kept, record.progress.done), (5, 3, 5));
    let result = at_once(rig.store.result(&job));
    assert_eq!(result.artefacts, digest_of("a", Fake::new(20, 3)).1);
    assert_eq!(result.history.iter().map(|row| row.index).collect::<Vec<_>>(), [0, 1, 2]);
    let states: Vec<_> = at_once(rig.store.events(&job, 0, 100)).iter().map(|e| e.event.sequence).collect();
    assert_eq!(states, (1..=states.len() as u64).collect::<Vec<_>>());
}

#[test]
fn all_slots_are_filled_at_start() {
    let mut rig = Rig::new();
    rig.submit("a", 20, 1);
    rig.connect("w", 2);
    rig.connect("v", 3);
    for worker in workers(&rig.scheduler) {
        assert_eq!(worker.busy, worker.slots, "{worker:?}");
    }
}

#[test]
fn demand_counts_whole_rounds_of_active_jobs() {
    let mut rig = Rig::new();
    assert_eq!(demand(&rig.scheduler), Demand::default());
    let a = rig.submit("bare a", 20, 2);
    rig.submit_job(job_of("bare b", Fake::of("bare b", 12, 1).with_lanes(5)));
    assert_eq!(demand(&rig.scheduler), Demand { wanted: 20 + 3, slots: 0, busy: 0 });
    rig.connect("w", 2);
    assert_eq!(demand(&rig.scheduler), Demand { wanted: 23, slots: 2, busy: 2 });
    let first = rig.take().unwrap();
    rig.answer(&first);
    assert_eq!(demand(&rig.scheduler).wanted, 23, "done tasks do not change the demand");
    rig.pause(&a, true);
    assert_eq!(demand(&rig.scheduler).wanted, 3, "a paused job counts for no slots");
    rig.pause(&a, false);
    rig.work_off();
    assert_eq!(demand(&rig.scheduler), Demand { wanted: 0, slots: 2, busy: 0 });
}

#[test]
fn short_tasks_are_leased_in_advance() {
    let mut rig = Rig::new();
    rig.submit("a", 2000, 1);
    rig.connect("w", 2);
    let first = rig.take().unwrap();
    let compute = Duration::from_millis(2) * first.range().count;
    let delivery = first.delivery();
    rig.complete(Completed { compute, ..first.completed(delivery) });
    assert_eq!(rig.scheduler.fleet.workers.values().next().unwrap().held.len(), 4);
}

#[test]
fn repeated_late_or_wrong_result_gets_its_verdict() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 6, 3);
    rig.connect("w", 6);
    let given = rig.take().unwrap();
    let delivery = given.delivery();
    assert_eq!(rig.complete(given.completed(delivery.clone())), Verdict::Accepted);
    assert_eq!(rig.complete(given.completed(delivery.clone())), Verdict::Duplicate);
    assert_eq!(rig.deliver_wrong(&rig.given_to("x", &given)), Verdict::Conflict);
    // A third worker decides and the round is sealed. The verdicts stay the same.
    rig.connect("third", 1);
    rig.work_to(&job, 1);
    assert_eq!(rig.complete(given.completed(delivery.clone())), Verdict::Duplicate);
    assert_eq!(rig.deliver_wrong(&rig.given_to("y", &given)), Verdict::Conflict);
    for id in ["x", "y"] {
        assert_eq!(rig.answer(&rig.given_to(id, &given)), Verdict::Quarantined, "{id} delivered a wrong result before");
    }
    // One round later the result is compared with the stored digests.
    rig.work_to(&job, 2);
    assert_eq!(rig.answer(&rig.given_to("z", &given)), Verdict::Duplicate);
    assert_eq!(rig.answer(&rig.given_to("x", &given)), Verdict::Quarantined);

    for (round, first) in [(7, 0), (2, 6), (3, 0)] {
        let mut beyond = given.clone();
        beyond.assign.range = Range { round, first, count: 1 };
        assert_eq!(rig.answer(&rig.given_to("w", &beyond)), Verdict::Unknown, "task {first} of round {round}");
    }
    let mut unknown = given.clone();
    unknown.assign.job = "j9-none".into();
    assert_eq!(rig.answer(&rig.given_to("w", &unknown)), Verdict::Unknown);

    on_cancel(&mut rig.scheduler, rig.now, &job);
    rig.commit_and_collect();
    assert_eq!(rig.complete(given.completed(delivery)), Verdict::Obsolete);
    assert_eq!(rig.stored(&job).state, JobState::Cancelled);
}

#[test]
fn late_result_after_expired_lease_counts() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 1, 1);
    rig.connect("slow", 1);
    let late = rig.take().unwrap();
    rig.connect("other", 1);
    rig.advance(LEASE / 2);
    let session = rig.scheduler.fleet.workers[&WorkerId("other".into())].session.unwrap();
    assert!(rig.beat("other", session, &[], &[]));
    rig.advance(LEASE / 2);
    let again = rig.take().expect("the task is leased to the other worker");
    assert_eq!((again.range(), again.worker.to_string()), (late.range(), "other".to_owned()));
    assert_eq!(rig.answer(&late), Verdict::Accepted);
    assert!(rig.cancelled.contains(&again.id()), "the second lease is revoked");
    rig.work_off();
    assert_eq!(rig.stored(&job).state, JobState::Succeeded);
}

#[test]
fn paused_job_stays_paused_over_restart() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 8, 2);
    rig.connect("w", 2);
    let running = rig.take().unwrap();
    let paused = rig.pause(&job, true).unwrap();
    assert!(paused.paused && rig.stored(&job).paused);
    assert_eq!(rig.stored(&job).state, JobState::Running, "pausing does not change the job's state");
    rig.work_off();
    assert_eq!(rig.answer(&running), Verdict::Accepted, "results of running leases count");
    assert_eq!((leased(&rig, &job), rig.given.len()), (0, 0), "a paused job gets no new leases");
    let events = rig.stored(&job).last_event;
    rig.pause(&job, true);
    assert_eq!(rig.stored(&job).last_event, events, "pausing a paused job adds no event");

    rig.restart();
    rig.connect("w", 2);
    assert_eq!(leased(&rig, &job), 0, "the pause survives a restart");
    assert!(rig.waits_for(&job).contains("until `evogait resume"));
    assert!(!rig.pause(&job, false).unwrap().paused);
    rig.work_off();
    rig.assert_right(&job, 8, 2);
    assert_eq!(rig.pause(&job, true), None, "an ended job can't be paused");
}

#[test]
fn paused_job_frees_slots_and_can_be_cancelled() {
    let mut rig = Rig::new();
    let (job, other) = (rig.submit("a", 8, 2), rig.submit("b", 8, 2));
    rig.pause(&job, true);
    rig.connect("w", 2);
    assert_eq!((leased(&rig, &job), leased(&rig, &other)), (0, 2));
    rig.work_off();
    assert_eq!(rig.stored(&other).state, JobState::Succeeded);
    let cancelled = on_cancel(&mut rig.scheduler, rig.now, &job).unwrap();
    rig.commit_and_collect();
    assert_eq!((cancelled.state, cancelled.paused), (JobState::Cancelled, false));
}

#[test]
fn heartbeat_of_lost_worker_is_refused() {
    let mut rig = Rig::new();
    let session = rig.connect("w", 1);
    let id = WorkerId("w".into());
    assert!(on_heartbeat(&mut rig.scheduler, rig.now, &id, session, &[], &[]));
    rig.advance(LEASE * 2);
    assert!(!on_heartbeat(&mut rig.scheduler, rig.now, &id, session, &[], &[]));
}

#[test]
fn returned_leases_cost_no_attempt() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 4, 1);
    for round in 0..5 {
        let id = format!("drains{round}");
        let session = rig.connect(&id, 4);
        rig.drain(id.as_str(), session, &[]);
        rig.commit_and_collect();
        assert_eq!(leased(&rig, &job), 0);
    }
    let session = rig.connect("rejects", 1);
    rig.given.drain(..rig.given.len() - 1);
    for _ in 0..5 {
        let given = rig.take().unwrap();
        on_return(&mut rig.scheduler, rig.now, &given.worker, session, given.id());
        rig.commit_and_collect();
        assert_eq!(leased(&rig, &job), 0, "the worker gets no work of a job that it just rejected");
        rig.now.since_start += LEASE / 2;
        assert!(on_heartbeat(&mut rig.scheduler, rig.now, &given.worker, session, &[], &[]));
        rig.advance(LEASE / 2);
    }
    rig.work_off();
    assert_eq!(rig.stored(&job).state, JobState::Succeeded);
}

#[test]
fn draining_worker_keeps_only_what_it_finishes() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 8, 1);
    let session = rig.connect("leaves", 3);
    let leaves = WorkerId("leaves".into());
    let kept = rig.take().expect("the worker has an assignment");
    on_drain(&mut rig.scheduler, rig.now, &leaves, session, &[kept.id()]);
    rig.commit_and_collect();
    assert_eq!(leased(&rig, &job), 1);

    // A second drain message returns the remaining leases.
    let second = rig.connect("also leaves", 1);
    let given_up = rig.given.pop().expect("the worker has an assignment");
    on_drain(&mut rig.scheduler, rig.now, &given_up.worker, second, &[given_up.id()]);
    on_drain(&mut rig.scheduler, rig.now, &given_up.worker, second, &[]);
    rig.commit_and_collect();
    assert_eq!(leased(&rig, &job), 1);

    assert_eq!(rig.answer(&kept), Verdict::Accepted);
    assert_eq!(leased(&rig, &job), 0);
    rig.given.clear();
    rig.connect("stays", 1);
    rig.work_off();
    assert_eq!(rig.stored(&job).state, JobState::Succeeded);
}

#[test]
fn poisoned_task_fails_its_job_with_reason() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 8, 1);
    let poison = 3;
    for round in 0..100 {
        if rig.stored(&job).state == JobState::Failed {
            break;
        }
        let id = format!("w{round}");
        let session = rig.connect(&id, 1);
        while let Some(given) = rig.take() {
            if given.range().indexes().contains(&poison) {
                rig.disconnect(id.as_str(), session);
                rig.advance(LEASE);
                break;
            }
            rig.answer(&given);
        }
    }
    let record = rig.stored(&job);
    assert_eq!(record.state, JobState::Failed);
    assert!(record.reason.contains("task 3 of round 0 failed 3 times"), "{}", record.reason);
    assert!(record.reason.contains("crashed while running it"), "{}", record.reason);
}

#[test]
fn reported_failure_counts_as_attempt() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 1, 1);
    rig.connect("w", 1);
    for attempt in 1..=MAX_ATTEMPTS {
        assert_eq!(rig.stored(&job).state, JobState::Running, "attempt {attempt}");
        let given = rig.take().unwrap();
        rig.complete(given.completed(Delivery::Failure("it panicked: why".to_owned())));
    }
    let record = rig.stored(&job);
    assert_eq!((record.state, record.ended_at_ms), (JobState::Failed, rig.now.unix_ms));
    assert!(record.reason.ends_with("it panicked: why"), "{}", record.reason);
}

#[test]
fn one_failing_worker_fails_no_job() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 5, 2);
    rig.connect("healthy", 1);
    rig.connect("a-sick", 1);
    // This worker is always the first to be free again.
    while !JobState::is_end(rig.stored(&job).state) {
        if let Some(given) = rig.take_of("a-sick") {
            rig.complete(given.completed(Delivery::Failure("it panicked".to_owned())));
        } else if let Some(given) = rig.take_of("healthy") {
            rig.answer(&given);
        } else {
            rig.advance(LEASE / 2);
            for id in ["a-sick", "healthy"] {
                rig.connect(id, 1);
            }
        }
    }
    rig.assert_right(&job, 5, 2);
}

#[test]
fn suspended_coordinator_expires_no_lease() {
    let mut rig = Rig::new();
    rig.submit("a", 5, 1);
    rig.connect("w", 1);
    rig.now.since_start += 100 * LEASE;
    on_standstill(&mut rig.scheduler, 100 * LEASE);
    rig.advance(Duration::ZERO);
    assert_eq!(rig.scheduler.leases.all.len(), 1);
    rig.advance(LEASE);
    assert!(rig.scheduler.leases.all.is_empty(), "leases expire after a lease time without heartbeats");
}

#[test]
fn reconnected_worker_keeps_its_leases() {
    let mut rig = Rig::new();
    rig.submit("a", 8, 1);
    let session = rig.connect("w", 2);
    let (first, second) = (rig.take().unwrap(), rig.take().unwrap());
    on_disconnect(&mut rig.scheduler, rig.now, &first.worker, session);
    let unknown = Running { assignment: AssignmentId(5), ..second.claim() };
    let future = Running { assignment: AssignmentId(u64::MAX), ..second.claim() };
    let running = vec![first.claim(), unknown, future];
    let welcome = rig.greet(Greeting { running, ..greeting("w", 2) });
    rig.commit_and_collect();
    assert_eq!(welcome.keep, [first.id()]);
    assert_eq!(welcome.drop, [AssignmentId(5), AssignmentId(u64::MAX)]);
    let again = rig.take().expect("the lease that the worker did not report is assigned again");
    assert_eq!(again.range().first, second.range().first);
}

#[test]
fn running_work_is_adopted_after_restart() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 8, 1);
    rig.connect("w", 1);
    let running = rig.take().unwrap();
    rig.restart();
    let claim = running.claim();
    let welcome = rig.greet(Greeting { running: vec![claim], ..greeting("w", 1) });
    rig.commit_and_collect();
    assert_eq!(welcome.keep, [running.id()]);
    assert!(rig.given.is_empty(), "the only slot is busy with the adopted lease");
    assert_eq!(rig.answer(&running), Verdict::Accepted);
    rig.work_off();
    rig.assert_right(&job, 8, 1);
}

/// Runs two endless jobs on four workers in simulated time. A task of the first takes `costs.0` ms, of the second
/// `costs.1`. Returns the slot time that each job got.
fn shares(priorities: (u32, u32), costs: (u64, u64)) -> (f64, f64) {
    let mut rig = Rig::new();
    let job = |rig: &mut Rig, name, priority| {
        on_submit(&mut rig.scheduler, rig.now, NewJob { priority, ..new_job(name, 1000, 1000) }).id
    };
    let a = job(&mut rig, "a", priorities.0);
    job(&mut rig, "b", priorities.1);
    for worker in 0..4 {
        rig.connect(&format!("w{worker}"), 1);
    }
    let (mut spent_a, mut spent_b) = (Duration::ZERO, Duration::ZERO);
    let mut free_at: BTreeMap<WorkerId, Duration> = BTreeMap::new();
    let mut clock = Duration::ZERO;
    while spent_a + spent_b < Duration::from_secs(10_000) {
        rig.given.retain(|g| !rig.cancelled.contains(&g.id()));
        let compute =
            |g: &Given| Duration::from_millis(if *g.job() == a { costs.0 } else { costs.1 }) * g.range().count;
        // Each worker runs its oldest assignment; the first that is ready delivers.
        let mut ready: BTreeMap<&WorkerId, (Duration, usize)> = BTreeMap::new();
        for (i, given) in rig.given.iter().enumerate() {
            let start = free_at.get(&given.worker).copied().unwrap_or_default();
            ready.entry(&given.worker).or_insert((start + compute(given), i));
        }
        let (at, index) = *ready.values().min().unwrap();
        clock = clock.max(at);
        let given = rig.given.remove(index);
        let compute = compute(&given);
        if *given.job() == a {
            spent_a += compute
        } else {
            spent_b += compute
        }
        let delivery = given.delivery();
        rig.complete(Completed { compute, ..given.completed(delivery) });
        // Idle workers continue from now.
        for worker in rig.scheduler.fleet.workers.keys() {
            let idle = !rig.given.iter().any(|g| g.worker == *worker) || *worker == given.worker;
            let free = free_at.entry(worker.clone()).or_default();
            if idle {
                *free = (*free).max(clock);
            }
        }
    }
    (spent_a.as_secs_f64(), spent_b.as_secs_f64())
}

#[test]
fn jobs_share_slot_time_by_priority() {
    let ratio = |(a, b): (f64, f64)| a / b;
    let even = ratio(shares((10, 10), (100, 100)));
    assert!((0.85..1.18).contains(&even), "{even}");
    // With equal numbers of tasks the ratio would be 20. It is not exactly 1: while the cheap job waits for the last
    // task of a round, the expensive one gets each free slot for a whole range.
    let dear_and_cheap = ratio(shares((10, 10), (1000, 50)));
    assert!((0.75..1.33).contains(&dear_and_cheap), "{dear_and_cheap}");
    let twice = ratio(shares((20, 10), (100, 100)));
    assert!((1.7..2.36).contains(&twice), "{twice}");
}

#[test]
fn job_of_missing_engine_waits_with_reason() {
    let mut rig = Rig::new();
    let other = NewJob { engine_digest: Digest([8; 32]), ..new_job("a", 4, 1) };
    let job = on_submit(&mut rig.scheduler, rig.now, other).id;
    rig.connect("w", 1);
    assert!(rig.given.is_empty());
    let reason = rig.waits_for(&job);
    assert!(reason.contains("engine 080808080808"), "{reason}");
}

#[test]
fn assignment_ids_differ_between_epochs() {
    let mut rig = Rig::new();
    rig.submit("a", 1, 1);
    rig.connect("w", 1);
    let before = rig.take().unwrap().id();
    rig.restart();
    rig.connect("v", 1);
    assert!(rig.take().unwrap().id() > before);
}
