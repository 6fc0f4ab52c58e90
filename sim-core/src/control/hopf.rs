//! Hopf oscillators, one for each joint: Eq. 2 of Vonásek and Faigl (2016), after Righetti and Ijspeert (2008).

use super::{Controller, Infeasible, Parameter, Signals, phase};
use crate::base::registry::Component;
use crate::base::simd::{Level, at_level};
use crate::model::Robot;
use crate::physics::TICK;
use fearless_simd::prelude::*;

/// Hopf oscillators: ẋ = α (μ − r²) x − ω y, ẏ = β (μ − r²) y + ω x, ω = ω₁ / (e^{−b y} + 1) + ω₂ / (e^{b y} + 1). The
/// signal is x.
///
/// For α, β > 0 an oscillator converges to the circle of radius √μ. It starts at x = 0.1, y = 0. The bounds are the
/// paper's.
pub struct Hopf;

/// Start of the oscillators, (x, y); the paper gives none.
const START: (f64, f64) = (0.1, 0.0);

/// Number of parameters of an oscillator.
const EACH: usize = 6;

impl Component for Hopf {
    fn name(&self) -> &'static str {
        "hopf"
    }
}

impl Controller for Hopf {
    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "mu", unit: "rad²", bounds: (0.3, 1.3) },
            Parameter { name: "alpha", unit: "1/(s·rad²)", bounds: (0.0, 50.0) },
            Parameter { name: "beta", unit: "1/(s·rad²)", bounds: (0.0, 50.0) },
            Parameter { name: "omega1", unit: "rad/s", bounds: (0.0, 4.0) },
            Parameter { name: "omega2", unit: "rad/s", bounds: (0.0, 4.0) },
            Parameter { name: "b", unit: "1/rad", bounds: (0.0, 0.5) },
        ]
    }

    /// Integrates the oscillators. The state holds x and y of every oscillator, eight bytes each.
    fn signals(&self, _: &Robot, gait: &[f64], from: Option<&[u8]>, ticks: usize) -> Result<Signals, Infeasible> {
        let mut states = match from {
            None => vec![START; gait.len() / EACH],
            Some(bytes) => read(bytes).filter(|s| s.len() == gait.len() / EACH).ok_or(phase::unfit())?,
        };
        let joints = at_level!(Level::new(), simd => integrate(simd, gait, &mut states, ticks));
        Ok(Signals {
            joints,
            end: states.iter().flat_map(|(x, y)| [x.to_le_bytes(), y.to_le_bytes()]).flatten().collect(),
        })
    }
}

/// Decodes the states of oscillators; `None` if the bytes are not whole pairs of numbers.
fn read(bytes: &[u8]) -> Option<Vec<(f64, f64)>> {
    let (numbers, rest) = bytes.as_chunks();
    let (states, alone) = numbers.as_chunks();
    let state = |&[x, y]: &[[u8; 8]; 2]| (f64::from_le_bytes(x), f64::from_le_bytes(y));
    (rest.is_empty() && alone.is_empty()).then(|| states.iter().map(state).collect())
}

/// Integrates all oscillators of a gait from the given states to those of the last tick, as many side by side as there
/// are lanes. It uses only sums, products and quotients, each rounded as IEEE 754 prescribes, so the bits are the same
/// at every width.
#[inline(always)]
fn integrate<S: Simd>(simd: S, gait: &[f64], states: &mut [(f64, f64)], ticks: usize) -> Vec<Vec<f64>> {
    let mut signals = Vec::with_capacity(gait.len() / EACH);
    for some in gait.chunks(EACH * S::f64s::LEN) {
        let oscillators = Oscillators::new(simd, some);
        let first = signals.len();
        signals.resize_with(first + some.len() / EACH, || Vec::with_capacity(ticks));
        let mut at = (number(simd, 0.0), number(simd, 0.0));
        for (lane, state) in states[first..].iter().take(S::f64s::LEN).enumerate() {
            (at.0[lane], at.1[lane]) = *state;
        }
        for tick in 0..ticks {
            if tick > 0 {
                at = oscillators.step(simd, at);
            }
            for (lane, signal) in signals[first..].iter_mut().enumerate() {
                signal.push(at.0[lane]);
            }
        }
        for (lane, state) in states[first..].iter_mut().take(S::f64s::LEN).enumerate() {
            *state = (at.0[lane], at.1[lane]);
        }
    }
    signals
}

/// Parameters of oscillators side by side; unused lanes are zero.
struct Oscillators<S: Simd> {
    mu: S::f64s,
    alpha: S::f64s,
    beta: S::f64s,
    /// ω₂; `more` is ω₁ − ω₂.
    omega2: S::f64s,
    more: S::f64s,
    b: S::f64s,
}

impl<S: Simd> Oscillators<S> {
    #[inline(always)]
    fn new(simd: S, gait: &[f64]) -> Self {
        let mut lanes = [number(simd, 0.0); EACH];
        for (lane, own) in gait.chunks(EACH).enumerate() {
            for i in 0..EACH {
                lanes[i][lane] = own[i];
            }
        }
        let [mu, alpha, beta, omega1, omega2, b] = lanes;
        Self { mu, alpha, beta, omega2, more: omega1 - omega2, b }
    }

    /// Returns the state one tick later, by the Runge–Kutta method of fourth order, which is stable here up to steps of
    /// about 21 ms.
    #[inline(always)]
    fn step(&self, simd: S, at: (S::f64s, S::f64s)) -> (S::f64s, S::f64s) {
        let (half, whole, two) = (number(simd, TICK / 2.0), number(simd, TICK), number(simd, 2.0));
        let k1 = self.rate(simd, at);
        let k2 = self.rate(simd, (at.0 + half * k1.0, at.1 + half * k1.1));
        let k3 = self.rate(simd, (at.0 + half * k2.0, at.1 + half * k2.1));
        let k4 = self.rate(simd, (at.0 + whole * k3.0, at.1 + whole * k3.1));
        let sixth = number(simd, TICK / 6.0);
        (at.0 + sixth * (k1.0 + two * (k2.0 + k3.0) + k4.0), at.1 + sixth * (k1.1 + two * (k2.1 + k3.1) + k4.1))
    }

    /// Returns the rate of change of (x, y) by Eq. 2.
    #[inline(always)]
    fn rate(&self, simd: S, (x, y): (S::f64s, S::f64s)) -> (S::f64s, S::f64s) {
        // 1 / (e^{−z} + 1) + 1 / (e^{z} + 1) = 1, so one sigmoid is enough for both terms.
        let omega = self.omega2 + self.more * sigmoid(simd, self.b * y);
        let pull = self.mu - (x * x + y * y);
        (self.alpha * pull * x - omega * y, self.beta * pull * y + omega * x)
    }
}

/// Returns the same number in every lane.
#[inline(always)]
fn number<S: Simd>(simd: S, value: f64) -> S::f64s {
    S::f64s::splat(simd, value)
}

/// Returns 1 / (1 + e^{−z}) with an error below 10⁻⁹: e^w = (e^{w/16})¹⁶ by a Taylor sum of degree 8, with z kept
/// within ± 20.
#[inline(always)]
fn sigmoid<S: Simd>(simd: S, z: S::f64s) -> S::f64s {
    let (one, most) = (number(simd, 1.0), number(simd, 20.0));
    let z = z.simd_gt(most).select(most, z);
    let z = z.simd_lt(-most).select(-most, z);
    let w = z * number(simd, -1.0 / 16.0);
    // Estrin's scheme, because the chain of dependent operations takes most of the time.
    let (w2, w4) = (w * w, w * w * (w * w));
    let low = (one + w) + w2 * (number(simd, 1.0 / 2.0) + w * number(simd, 1.0 / 6.0));
    let high = (number(simd, 1.0 / 24.0) + w * number(simd, 1.0 / 120.0))
        + w2 * (number(simd, 1.0 / 720.0) + w * number(simd, 1.0 / 5040.0));
    let mut power = low + w4 * (high + w4 * number(simd, 1.0 / 40_320.0));
    for _ in 0..4 {
        power = power * power;
    }
    one / (one + power)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::test_robot;

    /// Returns the signals from the controller's own start.
    fn signals(gait: &[f64], ticks: usize) -> Vec<Vec<f64>> {
        Hopf.signals(&test_robot(), gait, None, ticks).unwrap().joints
    }

    /// Returns ω of Eq. 2 as printed, rad/s.
    fn frequency(y: f64, omega1: f64, omega2: f64, b: f64) -> f64 {
        omega1 / (libm::exp(-b * y) + 1.0) + omega2 / (libm::exp(b * y) + 1.0)
    }

    fn maxima(signal: &[f64]) -> Vec<usize> {
        (1..signal.len() - 1).filter(|&i| signal[i - 1] < signal[i] && signal[i] >= signal[i + 1]).collect()
    }

    #[test]
    fn limit_cycle_has_radius_root_mu() {
        for (mu, alpha, beta) in [(0.3, 5.0, 5.0), (1.0, 50.0, 10.0), (1.3, 20.0, 50.0)] {
            let signal = &signals(&[mu, alpha, beta, 2.0, 3.0, 0.4], 6001)[0];
            let peak = signal[3000..].iter().cloned().fold(f64::MIN, f64::max);
            assert!((peak - mu.sqrt()).abs() < 2e-4, "mu {mu}: peak {peak}");
        }
    }

    /// On the limit cycle the phase φ turns at ω(y) with y = √μ sin φ, so one turn takes ∮ dφ / ω(√μ sin φ).
    #[test]
    fn period_equals_integral_of_inverse_frequency() {
        for (mu, omega1, omega2, b) in [(1.0, 4.0, 1.0, 0.5), (0.5, 2.0, 2.0, 0.0), (1.3, 3.0, 0.7, 0.3)] {
            let n = 10_000;
            let period: f64 = (0..n)
                .map(|i| {
                    let phase = 2.0 * std::f64::consts::PI * (f64::from(i) + 0.5) / f64::from(n);
                    let y = mu * libm::sin(phase) * libm::sin(phase);
                    2.0 * std::f64::consts::PI
                        / f64::from(n)
                        / frequency(libm::copysign(y.sqrt(), libm::sin(phase)), omega1, omega2, b)
                })
                .sum();
            // With α = β the pull towards the cycle is radial and does not change the phase.
            let signal = &signals(&[mu, 20.0, 20.0, omega1, omega2, b], 20_001)[0];
            let peaks = maxima(&signal[4000..]);
            let turns = peaks.len() - 1;
            let measured = (peaks[turns] - peaks[0]) as f64 * TICK / turns as f64;
            assert!((measured - period).abs() < 2e-3 * period, "{measured} against {period}");
        }
    }

    /// Integrates Eq. 2 as printed for one oscillator, with `libm`.
    fn printed(parameters: &[f64], ticks: usize) -> Vec<f64> {
        let &[mu, alpha, beta, omega1, omega2, b] = parameters else { unreachable!() };
        let rate = |(x, y): (f64, f64)| {
            let (omega, pull) = (frequency(y, omega1, omega2, b), mu - (x * x + y * y));
            (alpha * pull * x - omega * y, beta * pull * y + omega * x)
        };
        let step = |from: (f64, f64), by: f64, rate: (f64, f64)| (from.0 + by * rate.0, from.1 + by * rate.1);
        let mut at = START;
        let mut signal = Vec::new();
        for _ in 0..ticks {
            signal.push(at.0);
            let k1 = rate(at);
            let k2 = rate(step(at, TICK / 2.0, k1));
            let k3 = rate(step(at, TICK / 2.0, k2));
            let k4 = rate(step(at, TICK, k3));
            at.0 += TICK / 6.0 * (k1.0 + 2.0 * (k2.0 + k3.0) + k4.0);
            at.1 += TICK / 6.0 * (k1.1 + 2.0 * (k2.1 + k3.1) + k4.1);
        }
        signal
    }

    fn drawn(oscillators: u32) -> Vec<f64> {
        let mut stream = crate::base::random::Stream::new(1, crate::base::random::Purpose::Sample, 0, 0, 0);
        let each = Hopf.parameters();
        (0..oscillators)
            .flat_map(|_| each.iter().map(|p| stream.uniform(p.bounds.0, p.bounds.1)).collect::<Vec<_>>())
            .collect()
    }

    #[test]
    fn oscillator_follows_eq_2_beside_other_oscillators() {
        for joints in [1, 3, 8, 17] {
            let gait = drawn(joints);
            let told = signals(&gait, 2001);
            assert_eq!(told.len(), joints as usize);
            for (own, signal) in gait.chunks(6).zip(&told) {
                assert_eq!(signal, &signals(own, 2001)[0], "differs from the oscillator alone");
                for (a, b) in signal.iter().zip(printed(own, 2001)) {
                    assert!((a - b).abs() < 1e-8, "{a} against {b}");
                }
            }
        }
    }

    #[test]
    fn signal_with_large_b_follows_eq_2() {
        for b in [0.5, 5.0, 50.0, 1000.0] {
            let p = [1.0, 10.0, 10.0, 3.0, 1.0, b];
            let worst =
                signals(&p, 1001)[0].iter().zip(printed(&p, 1001)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-7, "b = {b}: off by {worst}");
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let gait = drawn(13);
        let told = signals(&gait, 2001);
        for level in crate::base::simd::levels() {
            let mut states = [START; 13];
            assert_eq!(told, at_level!(level, simd => integrate(simd, &gait, &mut states, 2001)));
        }
    }

    #[test]
    fn signals_at_corners_of_bounds_stay_bounded() {
        let bounds = Hopf.parameters();
        for corner in 0..1 << bounds.len() {
            let p: Vec<f64> = bounds
                .iter()
                .enumerate()
                .map(|(i, q)| if corner >> i & 1 == 0 { q.bounds.0 } else { q.bounds.1 })
                .collect();
            assert!(signals(&p, 6001)[0].iter().all(|x| x.abs() < 1.3), "{p:?}");
        }
    }
}
