//! Nearest-neighbour queries of the planner: the tree of places against a linear scan.
//!
//! A step is the work of one iteration of RRT-MP for one gait: find the place nearest to a random place, find the place
//! nearest to an arrival except its parent, and add one place. `at/N` measures steps in a set of N places. `grown/450`
//! measures 450 steps from an empty set on.

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use sim_core::base::random::{Purpose, Stream};
use sim_core::model::Place;
use sim_core::plan::{Metric, Nearest};
use std::f64::consts::PI;
use std::hint::black_box;

const METRIC: Metric = Metric { yaw_weight: 0.5, z: 0.0, roll: 0.0, pitch: 0.0, joints: 0.0 };
const STEPS: usize = 64;

trait Set: Clone {
    fn empty() -> Self;
    fn add(&mut self, place: Place);
    fn nearest(&self, q: &Place, but: Option<usize>) -> Option<(usize, f64)>;
}

impl Set for Nearest {
    fn empty() -> Self {
        Nearest::new(METRIC)
    }
    fn add(&mut self, place: Place) {
        self.add(place);
    }
    fn nearest(&self, q: &Place, but: Option<usize>) -> Option<(usize, f64)> {
        self.nearest(q, but)
    }
}

#[derive(Clone)]
struct Linear(Vec<Place>);

impl Set for Linear {
    fn empty() -> Self {
        Self(Vec::new())
    }
    fn add(&mut self, place: Place) {
        self.0.push(place);
    }
    fn nearest(&self, q: &Place, but: Option<usize>) -> Option<(usize, f64)> {
        let mut best: Option<(usize, f64)> = None;
        for (i, p) in self.0.iter().enumerate() {
            if Some(i) == but {
                continue;
            }
            let distance = METRIC.squared(p, q);
            if best.is_none_or(|b| distance < b.1) {
                best = Some((i, distance));
            }
        }
        best
    }
}

/// Returns a random place. The side of the map grows with the number of nodes, so that trees of all sizes are equally
/// dense.
fn random_place(stream: &mut Stream, nodes: usize) -> Place {
    let side = (nodes as f64 * 3.0).sqrt() / 2.0;
    let (x, y) = (stream.uniform(-side, side), stream.uniform(-side, side));
    Place { x, y, z: 0.4, yaw: stream.uniform(-PI, PI) }
}

fn step(set: &mut impl Set, stream: &mut Stream, size: usize, nodes: usize) {
    let near = set.nearest(&random_place(stream, nodes), None).map_or(0, |(i, _)| i);
    let new = random_place(stream, nodes);
    black_box(set.nearest(&new, (near < size).then_some(near)));
    set.add(new);
}

fn set<S: Set>(nodes: usize) -> S {
    let mut stream = Stream::new(1, Purpose::Sample, 0, 0, 0);
    let mut set = S::empty();
    (0..nodes).for_each(|_| set.add(random_place(&mut stream, nodes)));
    set
}

fn at<S: Set>(c: &mut Criterion, name: &str) {
    let mut group = c.benchmark_group("at");
    group.throughput(Throughput::Elements(STEPS as u64)).sample_size(10);
    for nodes in [450, 10_000, 100_000] {
        let grown: S = set(nodes);
        let mut stream = Stream::new(2, Purpose::Sample, 0, 0, 0);
        group.bench_function(BenchmarkId::new(name, nodes), |b| {
            let steps = |mut set: S| {
                (0..STEPS).for_each(|n| step(&mut set, &mut stream, nodes + n, nodes));
                set
            };
            b.iter_batched(|| grown.clone(), steps, BatchSize::LargeInput);
        });
    }
    group.finish();
}

fn grown<S: Set>(c: &mut Criterion, name: &str) {
    let mut group = c.benchmark_group("grown");
    group.throughput(Throughput::Elements(450));
    group.bench_function(BenchmarkId::new(name, 450), |b| {
        let mut stream = Stream::new(3, Purpose::Sample, 0, 0, 0);
        b.iter(|| {
            let mut set = S::empty();
            (0..450).for_each(|n| step(&mut set, &mut stream, n, 450));
            set
        });
    });
    group.finish();
}

fn nearest(c: &mut Criterion) {
    at::<Nearest>(c, "tree");
    at::<Linear>(c, "linear");
    grown::<Nearest>(c, "tree");
    grown::<Linear>(c, "linear");
}

criterion_group!(benches, nearest);
criterion_main!(benches);
