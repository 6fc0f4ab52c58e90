//! Robots, controllers, rollouts, planners, objectives and searches of evogait.
//!
//! Pure computation: no I/O, no clock, no threads of its own, no global random numbers. The same input gives the same
//! bits on every machine. Lengths are in map units (mu, one module length), times in s, angles in rad, masses in kg.
//!
//! The folders have an order: each uses those before it and none after it. The test `layers` of the crate
//! `cluster-tests` checks that.
//!
//! - [`base`]: maths, random streams, digests, limits, errors, scores
//! - [`genotype`]: what a search varies, and its space
//! - [`model`]: robots and environments: files, checks, catalogue, compiled robots, places on a map
//! - [`physics`]: rollouts: settings, motions, settling, and the engines rapier and lockstep
//! - [`engines`]: registry of engines: their digests, fidelity, and the choice `auto`
//! - [`exchange`]: robots in MJCF and URDF, in and out
//! - [`control`]: controllers: a gait's parameters in, joint targets out; the `[gaits]` table
//! - [`plan`]: planners, the table of transitions, and the `[planner]` table
//! - [`objective`]: what a tree is worth; the `[fitness]` table
//! - [`evaluate`]: candidates in, scores out
//! - [`search`]: searches by ask and tell, the archive, and the `[optimiser]` table
//! - [`problem`]: a job's settings, checked and prepared for evaluations
//! - [`report`]: records of motions, trees and paths
//! - [`procedure`]: what a job does, round by round
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
