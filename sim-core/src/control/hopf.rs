//! A Hopf oscillator a joint: Eq. 2 of Vonásek and Faigl (2016), after Righetti and Ijspeert (2008).

use super::{Controller, Parameter, TICK};

/// ẋ = α (μ − r²) x − ω y, ẏ = β (μ − r²) y + ω x, ω = ω₁ / (e^{−b y} + 1) + ω₂ / (e^{b y} + 1); the signal is x.
///
/// For α, β > 0 it converges to the circle of radius √μ. The bounds are the paper's. It starts at x = 0.1, y = 0.
pub struct Hopf;

/// Where oscillators start; the paper does not say.
const START: (f64, f64) = (0.1, 0.0);

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

    fn signal(&self, parameters: &[f64], ticks: usize) -> Vec<f64> {
        let &[mu, alpha, beta, omega1, omega2, b] = parameters else {
            unreachable!("a Hopf oscillator has six parameters")
        };
        let rate = |(x, y): (f64, f64)| {
            let omega = frequency(y, omega1, omega2, b);
            let pull = mu - (x * x + y * y);
            (alpha * pull * x - omega * y, beta * pull * y + omega * x)
        };
        let step = |from: (f64, f64), by: f64, rate: (f64, f64)| (from.0 + by * rate.0, from.1 + by * rate.1);
        let mut at = START;
        let mut signal = Vec::with_capacity(ticks);
        for _ in 0..ticks {
            signal.push(at.0);
            // Runge–Kutta of fourth order, stable here up to steps of about 21 ms.
            let k1 = rate(at);
            let k2 = rate(step(at, TICK / 2.0, k1));
            let k3 = rate(step(at, TICK / 2.0, k2));
            let k4 = rate(step(at, TICK, k3));
            at.0 += TICK / 6.0 * (k1.0 + 2.0 * (k2.0 + k3.0) + k4.0);
            at.1 += TICK / 6.0 * (k1.1 + 2.0 * (k2.1 + k3.1) + k4.1);
        }
        signal
    }
}

/// ω of Eq. 2, rad/s.
fn frequency(y: f64, omega1: f64, omega2: f64, b: f64) -> f64 {
    omega1 / (libm::exp(-b * y) + 1.0) + omega2 / (libm::exp(b * y) + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn maxima(signal: &[f64]) -> Vec<usize> {
        (1..signal.len() - 1).filter(|&i| signal[i - 1] < signal[i] && signal[i] >= signal[i + 1]).collect()
    }

    #[test]
    fn limit_cycle_has_radius_root_mu() {
        for (mu, alpha, beta) in [(0.3, 5.0, 5.0), (1.0, 50.0, 10.0), (1.3, 20.0, 50.0)] {
            let signal = Hopf.signal(&[mu, alpha, beta, 2.0, 3.0, 0.4], 6001);
            let peak = signal[3000..].iter().cloned().fold(f64::MIN, f64::max);
            assert!((peak - mu.sqrt()).abs() < 2e-4, "mu {mu}: peak {peak}");
        }
    }

    /// On the limit cycle the phase φ turns at ω(y) with y = √μ sin φ, so one turn takes ∮ dφ / ω(√μ sin φ).
    #[test]
    fn period_is_the_quadrature_of_one_over_omega() {
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
            // α = β keeps the pull radial, so it does not turn the phase on the cycle.
            let signal = Hopf.signal(&[mu, 20.0, 20.0, omega1, omega2, b], 20_001);
            let peaks = maxima(&signal[4000..]);
            let turns = peaks.len() - 1;
            let measured = (peaks[turns] - peaks[0]) as f64 * TICK / turns as f64;
            assert!((measured - period).abs() < 2e-3 * period, "{measured} against {period}");
        }
    }

    #[test]
    fn the_extremes_of_the_bounds_stay_finite() {
        let bounds = Hopf.parameters();
        for corner in 0..1 << bounds.len() {
            let p: Vec<f64> = bounds
                .iter()
                .enumerate()
                .map(|(i, q)| if corner >> i & 1 == 0 { q.bounds.0 } else { q.bounds.1 })
                .collect();
            assert!(Hopf.signal(&p, 6001).iter().all(|x| x.abs() < 1.3), "{p:?}");
        }
    }
}
