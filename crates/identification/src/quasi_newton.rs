//! Minimisation by a quasi-Newton method: L-BFGS (Nocedal and Wright, algorithm 7.4).

use std::collections::VecDeque;

/// Pairs of steps and changes of gradient that approximate the curvature.
const MEMORY: usize = 20;
/// Share of the linear decrease that a step must reach (Armijo).
const SUFFICIENT: f64 = 1e-4;
/// A step is halved at most this often.
const HALVINGS: usize = 30;

/// Goes downhill from `x` for at most `iterations` steps, or until the gradient's largest entry is
/// below `tolerance`, no step goes down any more, or `step` returns false.
///
/// `f` gives the value and writes the gradient; `step` sees the number of the step, the value and
/// the place after each step. Ends with the lowest place in `x`, and gives its value.
pub fn minimise(
    x: &mut [f64],
    iterations: usize,
    tolerance: f64,
    mut f: impl FnMut(&[f64], &mut [f64]) -> f64,
    mut step: impl FnMut(usize, f64, &[f64]) -> bool,
) -> f64 {
    let n = x.len();
    let (mut gradient, mut next_gradient) = (vec![0.0; n], vec![0.0; n]);
    let mut next = x.to_vec();
    let mut value = f(x, &mut gradient);
    let mut memory: VecDeque<Pair> = VecDeque::with_capacity(MEMORY);
    for iteration in 0..iterations {
        let steepest = gradient.iter().fold(0.0f64, |m, g| m.max(g.abs()));
        if steepest.is_nan() || steepest < tolerance {
            break;
        }
        let mut direction = newton_direction(&gradient, &memory);
        let mut slope = dot(&direction, &gradient);
        if slope.is_nan() || slope >= 0.0 {
            memory.clear();
            direction = gradient.iter().map(|g| -g).collect();
            slope = -dot(&gradient, &gradient);
        }
        // Without curvature the first step is a tenth of a unit.
        let mut length = if memory.is_empty() {
            0.1 / steepest.max(0.1)
        } else {
            1.0
        };
        let mut found = None;
        for _ in 0..HALVINGS {
            for ((next, x), d) in next.iter_mut().zip(x.iter()).zip(&direction) {
                *next = x + length * d;
            }
            let value_there = f(&next, &mut next_gradient);
            if value_there <= value + SUFFICIENT * length * slope {
                found = Some(value_there);
                break;
            }
            length *= 0.5;
        }
        let Some(value_there) = found else {
            if memory.is_empty() {
                break;
            }
            memory.clear();
            continue;
        };
        let pair = Pair::new(x, &next, &gradient, &next_gradient);
        if pair.product > 1e-12 * dot(&pair.change, &pair.change) {
            if memory.len() == MEMORY {
                memory.pop_back();
            }
            memory.push_front(pair);
        }
        x.copy_from_slice(&next);
        std::mem::swap(&mut gradient, &mut next_gradient);
        value = value_there;
        if !step(iteration, value, x) {
            break;
        }
    }
    value
}

/// A step and the change of gradient along it.
struct Pair {
    step: Vec<f64>,
    change: Vec<f64>,
    product: f64,
}

impl Pair {
    fn new(x: &[f64], next: &[f64], gradient: &[f64], next_gradient: &[f64]) -> Self {
        let step: Vec<f64> = next.iter().zip(x).map(|(a, b)| a - b).collect();
        let change: Vec<f64> = next_gradient
            .iter()
            .zip(gradient)
            .map(|(a, b)| a - b)
            .collect();
        Self {
            product: dot(&step, &change),
            step,
            change,
        }
    }
}

/// Minus the inverse of the remembered curvature times the gradient.
fn newton_direction(gradient: &[f64], memory: &VecDeque<Pair>) -> Vec<f64> {
    let mut q: Vec<f64> = gradient.iter().map(|g| -g).collect();
    let mut alphas = Vec::with_capacity(memory.len());
    for pair in memory {
        let alpha = dot(&pair.step, &q) / pair.product;
        add(&mut q, -alpha, &pair.change);
        alphas.push(alpha);
    }
    if let Some(newest) = memory.front() {
        let scale = newest.product / dot(&newest.change, &newest.change);
        q.iter_mut().for_each(|q| *q *= scale);
    }
    for (pair, alpha) in memory.iter().zip(alphas).rev() {
        let beta = dot(&pair.change, &q) / pair.product;
        add(&mut q, alpha - beta, &pair.step);
    }
    q
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn add(to: &mut [f64], factor: f64, x: &[f64]) {
    to.iter_mut().zip(x).for_each(|(to, x)| *to += factor * x);
}

#[cfg(test)]
mod tests {
    use super::minimise;

    #[test]
    fn finds_the_end_of_a_bent_valley() {
        // Rosenbrock in ten dimensions.
        let mut evaluations = 0;
        let mut x = [-1.2; 10];
        let value = minimise(
            &mut x,
            1000,
            1e-10,
            |x, gradient| {
                evaluations += 1;
                gradient.fill(0.0);
                let mut sum = 0.0;
                for i in 0..9 {
                    let (a, b) = (1.0 - x[i], x[i + 1] - x[i] * x[i]);
                    sum += a * a + 100.0 * b * b;
                    gradient[i] += -2.0 * a - 400.0 * b * x[i];
                    gradient[i + 1] += 200.0 * b;
                }
                sum
            },
            |_, _, _| true,
        );
        assert!(value < 1e-15, "{value}");
        assert!(x.iter().all(|x| (x - 1.0).abs() < 1e-7), "{x:?}");
        assert!(evaluations < 300, "{evaluations}");
    }
}
