//! Times the solvers side by side, beside the pseudo-inverses that Rust's libraries offer.
//!
//! Everything runs on one recorded sequence: a [`Galley`] of n/6 pairs of oars, which is the paper's boat at n = 6. A third
//! of the rows is redundant, and the null space turns. Two times are taken: from the assembled step to the multipliers, in
//! which forming A counts for those that need it, and from the recorded A and b, as the libraries' decompositions see them.
//! Right is who gives the minimum norm along this sequence, and along the same with rows that contradict one another, as
//! they do wherever loops stand open. Rounds are interleaved, the median of the rounds is what counts, and only ratios
//! within one table mean something.

use std::time::Instant;

use faer::{Mat, MatRef, Side};
use nalgebra::{DMatrix, DVector};

use crate::error::Error;
use crate::linalg::kernels::{norm, vectorised};
use crate::params::Options;
use crate::problem::Wanted;
use crate::registry::SOLVERS;
use crate::solvers::eigen::RANK_CUT;
use crate::solvers::solver::MultiplierSolver;
use crate::system::ConstrainedSystem;
use crate::test_problems::Galley;

/// The sizes of the published table.
pub const SIZES: [usize; 6] = [6, 12, 24, 48, 96, 192];

/// Relative distance from the minimum-norm solution above which a solver does not count as right.
pub const RIGHT: f64 = 1e-6;

/// Timestep of the recorded sequence, s, and where it begins: at t = 0 some rows happen to be proportional.
const TIMESTEP: f64 = 1e-3;
const BEGIN: f64 = 0.4;

/// What the accelerations asked for are off by in the contradicted sequence, m/s²: loops that stand open by 1e-6 m under
/// Baumgarte's k = 1e4 /s².
const CONTRADICTION: f64 = 1e-2;

/// Steps before the timed ones: carried solvers begin with an eigendecomposition, and need a past to predict from.
const WARM_UP: usize = 8;

/// One contestant at one size.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Timing {
    /// Name in the registry, or `library: method` of a pseudo-inverse that a library offers.
    pub name: String,
    /// Rows n.
    pub n: usize,
    /// Median over the rounds of the mean time of a solve, ns, from the assembled step.
    pub solve_ns: f64,
    /// The same from the recorded A and b.
    pub given_ns: f64,
    /// Largest relative distance from the minimum-norm solution over the sequence.
    pub min_norm_error: f64,
    /// The same where redundant rows contradict one another.
    pub contradicted_error: f64,
    /// Products a solve, mean; 0 for a library.
    pub products: f64,
    /// Whether it is a library's.
    pub library: bool,
}

impl Timing {
    /// Whether it gives the minimum-norm solution, contradicted or not.
    #[must_use]
    pub fn is_right(&self) -> bool {
        self.min_norm_error <= RIGHT && self.contradicted_error <= RIGHT
    }
}

/// Who takes part.
enum Contestant {
    Ours(Box<dyn MultiplierSolver>),
    Library(&'static str, LibrarySolve),
}

impl Contestant {
    /// Into x; gives the number of products.
    fn solve(
        &mut self,
        system: &mut ConstrainedSystem,
        (matrix, rhs): &Given,
        x: &mut [f64],
    ) -> Result<usize, Error> {
        match self {
            Self::Ours(solver) => Ok(system.solve_unchecked(&mut **solver, Wanted::Multipliers, x)?.products),
            Self::Library(_, solve) => {
                x.copy_from_slice(vectorised(|| solve(matrix, rhs)).as_slice());
                Ok(0)
            }
        }
    }

    fn reset(&mut self) {
        if let Self::Ours(solver) = self {
            solver.reset();
        }
    }
}

/// A and b of a step, as the libraries take them.
type Given = (DMatrix<f64>, DVector<f64>);

/// A⁺ b by a library's decomposition.
type LibrarySolve = fn(&DMatrix<f64>, &DVector<f64>) -> DVector<f64>;

const LIBRARIES: [(&str, LibrarySolve); 4] = [
    ("nalgebra: symmetric eigen", nalgebra_eigen),
    ("faer: symmetric eigen", faer_eigen),
    ("nalgebra: SVD", nalgebra_svd),
    ("faer: SVD", faer_svd),
];

/// U f(w) Uᵀ b with the eigenvalues (or singular values) below the cut dropped.
fn apply_inverse(u: &DMatrix<f64>, values: &DVector<f64>, rhs: &DVector<f64>) -> DVector<f64> {
    let cut = RANK_CUT * values.amax();
    let mut inner = u.tr_mul(rhs);
    for (entry, &value) in inner.iter_mut().zip(values.iter()) {
        *entry = if value > cut { *entry / value } else { 0.0 };
    }
    u * inner
}

fn nalgebra_eigen(matrix: &DMatrix<f64>, rhs: &DVector<f64>) -> DVector<f64> {
    let eigen = matrix.clone().symmetric_eigen();
    apply_inverse(&eigen.eigenvectors, &eigen.eigenvalues, rhs)
}

fn nalgebra_svd(matrix: &DMatrix<f64>, rhs: &DVector<f64>) -> DVector<f64> {
    let svd = matrix.clone().svd(true, true);
    let cut = RANK_CUT * svd.singular_values.max();
    svd.solve(rhs, cut).unwrap_or_else(|_| DVector::zeros(rhs.len()))
}

fn faer_view(matrix: &DMatrix<f64>) -> MatRef<'_, f64> {
    MatRef::from_column_major_slice(matrix.as_slice(), matrix.nrows(), matrix.ncols())
}

/// V f(w) Uᵀ b of a decomposition of faer.
fn apply_faer(u: MatRef<'_, f64>, v: MatRef<'_, f64>, values: &[f64], rhs: &DVector<f64>) -> DVector<f64> {
    let n = rhs.len();
    let cut = RANK_CUT * values.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    let mut inner = u.transpose() * MatRef::from_column_major_slice(rhs.as_slice(), n, 1);
    for (i, &value) in values.iter().enumerate() {
        inner[(i, 0)] = if value > cut { inner[(i, 0)] / value } else { 0.0 };
    }
    let x: Mat<f64> = v * inner;
    DVector::from_iterator(n, (0..n).map(|i| x[(i, 0)]))
}

fn faer_eigen(matrix: &DMatrix<f64>, rhs: &DVector<f64>) -> DVector<f64> {
    faer_view(matrix).self_adjoint_eigen(Side::Lower).map_or_else(
        |_| DVector::zeros(rhs.len()),
        |eigen| {
            let values: Vec<f64> = eigen.S().column_vector().iter().copied().collect();
            apply_faer(eigen.U(), eigen.U(), &values, rhs)
        },
    )
}

fn faer_svd(matrix: &DMatrix<f64>, rhs: &DVector<f64>) -> DVector<f64> {
    faer_view(matrix).svd().map_or_else(
        |_| DVector::zeros(rhs.len()),
        |svd| {
            let values: Vec<f64> = svd.S().column_vector().iter().copied().collect();
            apply_faer(svd.U(), svd.V(), &values, rhs)
        },
    )
}

/// Steps of a sequence that is timed: fewer of the large ones.
fn steps(n: usize) -> usize {
    (200_000 / (n * n)).clamp(32, 2000)
}

fn distance(x: &[f64], truth: &[f64]) -> f64 {
    let difference: Vec<f64> = x.iter().zip(truth).map(|(a, b)| a - b).collect();
    norm(&difference) / norm(truth)
}

/// Every solver of the registry, and the libraries' pseudo-inverses, at one size.
///
/// `interrupted` is asked between solves, of small systems between sequences of them; once it says so, the table is empty.
///
/// # Errors
/// [`Error::Shape`] if n is not a multiple of 6 and at least 6; whatever a solver refuses.
pub fn compare(n: usize, rounds: usize, interrupted: impl FnMut() -> bool) -> Result<Vec<Timing>, Error> {
    if n == 0 || !n.is_multiple_of(6) {
        let expected = "a multiple of 6, at least 6".to_owned();
        return Err(Error::Shape { what: "n", expected, got: n.to_string() });
    }
    let mut watch = Watch { interrupted, ended: false };
    let mut smooth = Sequence::record(n, 0.0, &mut watch)?;
    let mut contradicted = Sequence::record(n, CONTRADICTION, &mut watch)?;
    let ours = SOLVERS.iter().map(|kind| (kind.build)(&Options::new()).map(Contestant::Ours));
    let libraries = LIBRARIES.iter().map(|&(name, solve)| Ok(Contestant::Library(name, solve)));
    let mut contestants = ours.chain(libraries).collect::<Result<Vec<_>, Error>>()?;
    let mut table: Vec<Timing> = contestants
        .iter()
        .map(|contestant| {
            let (name, library) = match contestant {
                Contestant::Ours(solver) => (solver.name(), false),
                Contestant::Library(name, _) => (*name, true),
            };
            Timing { name: name.to_owned(), n, library, ..Timing::default() }
        })
        .collect();
    let mut times = vec![[const { Vec::new() }; 2]; contestants.len()];
    for (contestant, timing) in contestants.iter_mut().zip(&mut table) {
        (timing.contradicted_error, _) = contradicted.follow(contestant, &mut watch)?;
        (timing.min_norm_error, timing.products) = smooth.follow(contestant, &mut watch)?;
    }
    for round in 0..rounds.max(1) {
        // There and back: who comes first after the libraries takes up to twice as long at n = 6.
        let mut order: Vec<_> = contestants.iter_mut().zip(&mut times).collect();
        if !round.is_multiple_of(2) {
            order.reverse();
        }
        for (contestant, times) in order {
            for (forming, times) in [true, false].into_iter().zip(times.iter_mut()) {
                // Once untimed: nobody pays for what the one before left in the caches.
                smooth.time(contestant, forming, &mut watch)?;
                times.push(smooth.time(contestant, forming, &mut watch)?);
            }
        }
        if watch.ends() {
            return Ok(Vec::new());
        }
    }
    let median = |times: &mut Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    for (timing, mut times) in table.iter_mut().zip(times) {
        (timing.solve_ns, timing.given_ns) = (median(&mut times[0]), median(&mut times[1]));
    }
    Ok(table)
}

/// Rows from which a solve takes so long that asking for interruptions beside it costs nothing that shows.
const LARGE: usize = 96;

/// Looks for interruptions, and remembers the first.
struct Watch<F> {
    interrupted: F,
    ended: bool,
}

impl<F: FnMut() -> bool> Watch<F> {
    fn ends(&mut self) -> bool {
        self.ended = self.ended || (self.interrupted)();
        self.ended
    }
}

/// A recorded sequence with its solutions.
struct Sequence {
    systems: Vec<ConstrainedSystem>,
    given: Vec<Given>,
    truth: Vec<Vec<f64>>,
    x: Vec<f64>,
}

impl Sequence {
    /// A galley with n rows, whose accelerations asked for are off by `contradiction` of their size.
    fn record(n: usize, contradiction: f64, watch: &mut Watch<impl FnMut() -> bool>) -> Result<Self, Error> {
        let count = WARM_UP + steps(n);
        let mut systems = vec![ConstrainedSystem::new(); count];
        for (step, system) in systems.iter_mut().enumerate() {
            if watch.ends() {
                break;
            }
            let time = BEGIN + TIMESTEP * step as f64;
            let mut galley = Galley::new(n / 6, time);
            galley.contradict(|row| contradiction * (7.0 * time + row as f64).sin());
            system.assemble(&galley.view())?;
        }
        let give = |system: &ConstrainedSystem| {
            let matrix = DMatrix::from_column_slice(n, n, &system.full_matrix());
            (matrix, DVector::from_column_slice(system.rhs()))
        };
        let mut given: Vec<Given> = Vec::new();
        let mut truth = Vec::new();
        for system in &systems {
            if watch.ends() {
                break;
            }
            let (matrix, rhs) = give(system);
            truth.push(faer_eigen(&matrix, &rhs).as_slice().to_vec());
            given.push((matrix, rhs));
        }
        Ok(Self { systems, given, truth, x: vec![0.0; n] })
    }

    /// Largest relative distance from the minimum norm, and products a solve.
    fn follow(
        &mut self,
        contestant: &mut Contestant,
        watch: &mut Watch<impl FnMut() -> bool>,
    ) -> Result<(f64, f64), Error> {
        let (mut worst, mut products) = (0.0_f64, 0);
        contestant.reset();
        for ((system, given), truth) in self.systems.iter_mut().zip(&self.given).zip(&self.truth) {
            if watch.ends() {
                break;
            }
            products += contestant.solve(system, given, &mut self.x)?;
            worst = worst.max(distance(&self.x, truth));
        }
        Ok((worst, products as f64 / self.systems.len() as f64))
    }

    /// Mean time of a solve, ns; `forming`: A is not there yet.
    fn time(
        &mut self,
        contestant: &mut Contestant,
        forming: bool,
        watch: &mut Watch<impl FnMut() -> bool>,
    ) -> Result<f64, Error> {
        let large = self.x.len() >= LARGE;
        if watch.ends() {
            return Ok(f64::NAN);
        }
        contestant.reset();
        for system in &mut self.systems {
            if forming { system.forget_matrix() } else { system.form_matrix() }
        }
        let mut begin = Instant::now();
        for (step, (system, given)) in self.systems.iter_mut().zip(&self.given).enumerate() {
            if large && watch.ends() {
                break;
            }
            if step == WARM_UP {
                begin = Instant::now();
            }
            contestant.solve(system, given, &mut self.x)?;
        }
        Ok(begin.elapsed().as_secs_f64() * 1e9 / (self.systems.len() - WARM_UP) as f64)
    }
}
