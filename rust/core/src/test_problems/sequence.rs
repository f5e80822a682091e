//! Random sequences of slowly varying A x = b, A = J Jᵀ, with J known: so A⁺ b is known to any precision.
//!
//! ```text
//!     J(k) = E G(k) U R(k) diag(σ)        E: n×m duplicates some rows and adds zero ones; U: m×r orthonormal;
//!                                         G, R: rotations by k δ; G = 1 where null(A) is to stand still
//! ```
//!
//! J in doubles is the definition; A handed to a solver is J Jᵀ rounded. The same seed gives the same sequence everywhere.

use nalgebra::DMatrix;

/// Largest condition number λ₁/λ⁺ of A on its range.
pub const LARGEST_CONDITION: f64 = 1e8;

/// Shares of the n rows that may be copies, and zero, in percent.
const COPIES: usize = 20;
const ZEROS: usize = 10;

/// The generator `SplitMix64` (Steele, Lea, Flood 2014).
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// With a seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// 64 random bits.
    pub const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [low, high).
    pub const fn uniform(&mut self, low: f64, high: f64) -> f64 {
        (high - low) * ((self.bits() >> 11) as f64 / (1_u64 << 53) as f64) + low
    }

    /// Uniform among 0…bound − 1; 0 for a bound of 0.
    #[allow(clippy::cast_possible_truncation)] // Less than the bound, which is a usize.
    pub const fn below(&mut self, bound: usize) -> usize {
        if bound == 0 { 0 } else { (self.bits() % bound as u64) as usize }
    }

    /// True once in `n` times.
    pub const fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }
}

/// A rotation in the plane of two axes, by `speed` rad a step.
#[derive(Debug, Clone, Copy)]
struct Turn {
    axes: (usize, usize),
    speed: f64,
}

/// One step of a [`Sequence`].
#[derive(Debug, Clone)]
pub struct SequenceStep {
    /// J, `n×r`, column-major, of full column rank.
    pub factor: Vec<f64>,
    /// b, `n`.
    pub rhs: Vec<f64>,
}

impl SequenceStep {
    /// r.
    #[must_use]
    pub const fn rank(&self) -> usize {
        self.factor.len() / self.rhs.len()
    }

    /// A = J Jᵀ, `n×n`, rounded, exactly symmetric.
    #[must_use]
    pub fn matrix(&self) -> Vec<f64> {
        let factor = DMatrix::from_column_slice(self.rhs.len(), self.rank(), &self.factor);
        let mut product = &factor * factor.transpose();
        product.fill_upper_triangle_with_lower_triangle();
        product.data.into()
    }
}

/// A sequence of systems; see the module.
#[derive(Debug, Clone)]
pub struct Sequence {
    /// The seed that it came from.
    pub seed: u64,
    /// Steps, 8 to 15.
    pub steps: usize,
    /// Relative change of J a step, 1e-5 to 1e-2.
    pub change: f64,
    /// λ₁/λ⁺ of A, to a factor of 2.
    pub condition: f64,
    /// Whether b is in range(A), b = J c.
    pub consistent: bool,
    /// Whether null(A) turns.
    pub turning: bool,
    /// The steps at which the rank drops by one and comes back, if it does.
    pub jump: Option<(usize, usize)>,
    /// Which of the m rows each of the n rows is; `None` for a zero row.
    rows: Vec<Option<usize>>,
    base: DMatrix<f64>,
    singular: Vec<f64>,
    left: Vec<Turn>,
    right: Vec<Turn>,
    /// b or c at step 0 and its change a step.
    rhs: Vec<(f64, f64)>,
}

impl Sequence {
    /// The sequence of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut random = Random::new(seed);
        // Small sizes oftener than large ones: mechanisms are small, and an oracle costs n³.
        let n = 2 + if random.one_in(4) { random.below(59) } else { random.below(19) };
        let rank = n - random.below(n / 2 + 1);
        let copies = random.below((n - rank).min(n * COPIES / 100 + 1) + 1);
        let zeros = random.below((n - rank - copies).min(n * ZEROS / 100 + 1) + 1);
        let base_rows = n - copies - zeros;
        let mut rows: Vec<_> = (0..base_rows).chain(0..copies).map(Some).collect();
        rows.resize(n, None);
        for i in (1..n).rev() {
            rows.swap(i, random.below(i + 1));
        }

        let change = 10.0_f64.powf(random.uniform(-5.0, -2.0));
        // Copies of a row raise λ₁ by up to 2.
        let condition = 10.0_f64.powf(random.uniform(0.0, (0.5 * LARGEST_CONDITION).log10()));
        let scale = 10.0_f64.powf(random.uniform(-4.0, 4.0));
        let singular = (0..rank).map(|i| match i {
            0 => scale,
            1 => scale / condition.sqrt(),
            _ => scale * condition.powf(random.uniform(-0.5, 0.0)),
        });
        let singular = singular.collect();
        let turning = random.one_in(2);
        let base = DMatrix::from_fn(base_rows, rank, |_, _| random.uniform(-1.0, 1.0)).qr().q();
        let left = if turning { turns(&mut random, base_rows, change) } else { Vec::new() };
        let right = turns(&mut random, rank, change);
        let steps = 8 + random.below(8);
        let jump = (rank > 2 && random.one_in(4)).then(|| {
            let first = 2 + random.below(steps - 4);
            (first, first + 1 + random.below(4))
        });
        let consistent = random.one_in(2);
        let rhs_scale = 10.0_f64.powf(random.uniform(-8.0, 8.0));
        let mut entry = || {
            let value = rhs_scale * random.uniform(-1.0, 1.0);
            (value, change * rhs_scale * random.uniform(-1.0, 1.0))
        };
        let rhs = (0..if consistent { rank } else { n }).map(|_| entry()).collect();
        Self {
            seed,
            steps,
            change,
            condition,
            consistent,
            turning,
            jump,
            rows,
            base,
            singular,
            left,
            right,
            rhs,
        }
    }

    /// n.
    #[must_use]
    pub fn size(&self) -> usize {
        self.rows.len()
    }

    /// rank(A) at a step.
    #[must_use]
    pub fn rank(&self, step: usize) -> usize {
        let dropped = self.jump.is_some_and(|(from, to)| (from..to).contains(&step));
        self.base.ncols() - usize::from(dropped)
    }

    /// J and b at a step.
    #[must_use]
    pub fn step(&self, step: usize) -> SequenceStep {
        let time = step as f64;
        let rank = self.rank(step);
        let mut turned = self.base.clone();
        for turn in &self.left {
            let (sin, cos) = (turn.speed * time).sin_cos();
            for col in 0..turned.ncols() {
                let (p, q) = (turned[(turn.axes.0, col)], turned[(turn.axes.1, col)]);
                turned[(turn.axes.0, col)] = cos * p - sin * q;
                turned[(turn.axes.1, col)] = sin * p + cos * q;
            }
        }
        for turn in &self.right {
            let (sin, cos) = (turn.speed * time).sin_cos();
            for row in 0..turned.nrows() {
                let (p, q) = (turned[(row, turn.axes.0)], turned[(row, turn.axes.1)]);
                turned[(row, turn.axes.0)] = cos * p - sin * q;
                turned[(row, turn.axes.1)] = sin * p + cos * q;
            }
        }
        let factor = DMatrix::from_fn(self.size(), rank, |row, col| {
            self.rows[row].map_or(0.0, |source| turned[(source, col)] * self.singular[col])
        });
        let along = |&(value, rate): &(f64, f64)| rate * time + value;
        let entries: Vec<f64> = self.rhs.iter().map(along).collect();
        let rhs = if self.consistent {
            let row = |row: usize| (0..rank).map(|col| factor[(row, col)] * entries[col]).sum();
            (0..self.size()).map(row).collect()
        } else {
            entries
        };
        SequenceStep { factor: factor.data.into(), rhs }
    }
}

/// As many rotations as axes, so that all of them move.
fn turns(random: &mut Random, size: usize, speed: f64) -> Vec<Turn> {
    let turn = |first: usize| {
        let second = (first + 1 + random.below(size - 1)) % size;
        Turn { axes: (first, second), speed: speed * random.uniform(-1.0, 1.0) }
    };
    if size < 2 { Vec::new() } else { (0..size).map(turn).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn promises_hold() {
        for seed in 0..200 {
            let sequence = Sequence::new(seed);
            let mut last: Option<DMatrix<f64>> = None;
            for step in 0..sequence.steps {
                let SequenceStep { factor, rhs } = sequence.step(step);
                let factor = DMatrix::from_vec(rhs.len(), factor.len() / rhs.len(), factor);
                assert_eq!((factor.nrows(), factor.ncols()), (sequence.size(), sequence.rank(step)));
                assert!((2..=60).contains(&rhs.len()) && 2 * sequence.base.ncols() >= rhs.len());
                let singular = factor.clone().svd(false, false).singular_values;
                assert!((singular.max() / singular.min()).powi(2) < 1.01 * LARGEST_CONDITION, "{seed}");
                if let Some(last) = last.filter(|last| last.shape() == factor.shape()) {
                    let change = (&factor - last).norm() / factor.norm();
                    assert!(change < 4.0 * sequence.change, "{seed}: {change} {}", sequence.change);
                }
                last = Some(factor);
            }
        }
    }

    #[test]
    fn a_seed_means_one_sequence() {
        assert_eq!(Random::new(1_234_567).bits(), 6_457_827_717_110_365_317);
        assert_eq!(Sequence::new(7).step(3).factor, Sequence::new(7).step(3).factor);
    }
}
