//! Rendering until the picture is good enough.

use super::{Budget, Rendering};
use quietlight_denoise::Layers;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Samples per pixel at which the error is looked at first: with fewer, what the halves say of it is vague.
const FIRST: u32 = 8;

/// By what the number of samples grows from one look to the next: looking costs three denoisings, and a look too late costs
/// samples.
const LEAST_GROWTH: f64 = 1.25;
const MOST_GROWTH: f64 = 4.0;

/// Exponents `p` of an error that falls as `1/samples^p`: noise falls with 1, what denoising leaves slower.
const EXPONENTS: [f64; 2] = [0.35, 1.0];

/// When a picture is good enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Relative L2 at which to stop.
    pub error: f64,
    /// What is spent at most.
    pub most: Budget,
}

/// Why rendering ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The estimated error is at most what was asked for.
    Reached,
    /// All that may be spent was spent before.
    Spent,
    /// The user stopped it.
    Stopped,
    /// The error cannot be estimated.
    Unknown,
}

impl Target {
    /// Goes on with `rendering` until `judge` estimates an error of at most the target. `advance` goes on until there are so
    /// many samples per pixel, or `stop` is true. `judge` gets the samples per pixel and the layers, and tells the relative L2
    /// of the picture made of them, if it can; it is not called on the threads of `threads`. What it says last is of the layers
    /// as they are at the end, unless that was stopped.
    ///
    /// # Errors
    /// Those of `judge`, as they come.
    pub fn reach<E>(
        &self,
        rendering: &mut Rendering<'_>,
        threads: &rayon::ThreadPool,
        mut advance: impl FnMut(&mut Rendering<'_>, u32),
        stop: &AtomicBool,
        mut judge: impl FnMut(u32, &Layers) -> Result<Option<f64>, E>,
    ) -> Result<Ending, E> {
        let start = Instant::now();
        let most = |samples: u32, rendered: Duration, judged: Duration| match self.most {
            Budget::Samples(most) => most,
            Budget::Time(time) => affordable(time, samples, rendered, start.elapsed(), judged),
        };
        let mut goal = match self.most {
            Budget::Samples(most) => most.min(FIRST),
            Budget::Time(_) => FIRST,
        };
        let (mut before, mut rendered) = (None, Duration::ZERO);
        loop {
            let round = Instant::now();
            advance(rendering, goal);
            rendered += round.elapsed();
            if stop.load(Ordering::Relaxed) {
                return Ok(Ending::Stopped);
            }
            let look = Instant::now();
            let layers = threads.install(|| rendering.layers());
            let samples = rendering.samples();
            let Some(error) = judge(samples, &layers)? else { return Ok(Ending::Unknown) };
            if error <= self.error {
                return Ok(Ending::Reached);
            }
            let most = most(samples, rendered, look.elapsed());
            if samples >= most {
                return Ok(Ending::Spent);
            }
            goal = next_goal((samples, error), before, self.error).min(most);
            before = Some((samples, error));
        }
    }
}

/// Samples per pixel in all that fit into `time`, with one more look at the end; no more than there are where none do.
fn affordable(
    time: Duration,
    samples: u32,
    rendered: Duration,
    elapsed: Duration,
    look: Duration,
) -> u32 {
    let left = time.saturating_sub(elapsed).saturating_sub(look).as_secs_f64();
    let more = left * f64::from(samples) / rendered.as_secs_f64().max(1e-9);
    samples.saturating_add(more as u32)
}

/// Samples at which the error should be that of the target, by how it has fallen between the last two looks.
fn next_goal((samples, error): (u32, f64), before: Option<(u32, f64)>, target: f64) -> u32 {
    let exponent = before.map_or(EXPONENTS[1], |(fewer, worse)| {
        let fell = (worse / error).ln() / (f64::from(samples) / f64::from(fewer)).ln();
        if fell.is_finite() { fell.clamp(EXPONENTS[0], EXPONENTS[1]) } else { EXPONENTS[1] }
    });
    let growth = (error / target).powf(1.0 / exponent).clamp(LEAST_GROWTH, MOST_GROWTH);
    (f64::from(samples) * growth).ceil() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_look_is_where_the_error_should_be_small_enough() {
        // Nothing known: 1/n. Half the error at twice the samples.
        assert_eq!(next_goal((8, 0.02), None, 0.01), 16);
        // It fell by √2 with twice the samples: p = 1/2, and half the error wants four times as many.
        assert_eq!(next_goal((16, 0.02), Some((8, 0.02 * 2f64.sqrt())), 0.01), 64);
        // Within bounds, whatever the errors did.
        assert_eq!(next_goal((100, 1.0), None, 1e-9), 400);
        assert_eq!(next_goal((100, 0.010_01), None, 0.01), 125);
        assert_eq!(next_goal((16, 0.02), Some((8, 0.01)), 0.019), 20);
        assert_eq!(next_goal((16, f64::INFINITY), Some((8, 0.0)), 0.01), 64);
    }

    #[test]
    fn time_that_is_left_is_spent_but_for_the_last_look() {
        let s = Duration::from_secs;
        // 10 samples took 2 s; of 20 s 5 are gone and 5 will be needed.
        assert_eq!(affordable(s(20), 10, s(2), s(5), s(5)), 60);
        assert_eq!(affordable(s(20), 10, s(2), s(18), s(5)), 10);
    }
}
