//! Robots, controllers, rollouts, planners, objectives and searches of evogait.
//!
//! Pure computation: no I/O, no clock, no threads of its own, no global random numbers. The same input gives the same
//! bits on every machine. Lengths are in map units (mu, one module length), times in s, angles in rad, masses in kg.
//!
//! The folders are ordered: each uses only those before it. The test `layers` of the crate `cluster-tests` checks that.
//!
//! - [`base`]: maths, random streams, digests, limits, errors, scores
//! - [`genotype`]: genotypes, which a search varies, and their space
//! - [`model`]: robots and environments: files, checks, catalogue, compiled robots, places on a map
//! - [`physics`]: rollouts: settings, motions, settling, and the engines rapier and lockstep
//! - [`engines`]: registry of engines: their digests, fidelity, and the choice `auto`
//! - [`exchange`]: import and export of robots in MJCF and URDF
//! - [`control`]: controllers, which turn a gait's parameters into joint targets; the `[gaits]` table
//! - [`plan`]: planners, the table of transitions, and the `[planner]` table
//! - [`objective`]: objectives, which score trees; the `[fitness]` table
//! - [`evaluate`]: evaluation of candidates: their trees and scores
//! - [`search`]: searches with an ask-and-tell interface, the archive, and the `[optimiser]` table
//! - [`problem`]: a job's settings, checked and prepared for evaluations
//! - [`report`]: records of motions, trees and paths
//! - [`procedure`]: procedures, the work of a job round by round
//! - [`job`]: the job file

pub mod base;

pub mod genotype;

pub mod model;

pub mod physics;

pub mod engines;

pub mod exchange;

pub mod control;

pub mod plan;

pub mod objective;

pub mod evaluate;

pub mod search;

pub mod problem;

pub mod report;

pub mod procedure;

pub mod job;
