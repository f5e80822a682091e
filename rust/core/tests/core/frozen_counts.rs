//! The work of named runs, frozen: one table. A change of a count is a change of the algorithm, or of a few roundings
//! in libm, faer or the processor's fused products, and is then taken over on purpose (`--nocapture` writes the table
//! anew).

use oarlock_core::test_problems::n_four_bar::{NFourBar, trajectory};
use oarlock_core::test_problems::{BoatStep, boat};
use oarlock_core::{ConstrainedSystem, Info, Options, Status, StepView, Wanted, make_solver};

/// Counts of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Counts {
    /// Iterations of all solves.
    total: usize,
    /// The most of one solve.
    most: usize,
    /// Solves that started anew from an eigendecomposition.
    refreshes: usize,
    /// Solves that did not converge.
    failures: usize,
}

impl Counts {
    const fn new(total: usize, most: usize, refreshes: usize, failures: usize) -> Self {
        Self { total, most, refreshes, failures }
    }

    fn add(&mut self, info: &Info) {
        self.total += info.iterations;
        self.most = self.most.max(info.iterations);
        self.refreshes += usize::from(info.refreshed);
        self.failures += usize::from(info.status != Status::Converged);
    }
}

/// Where the counts are frozen to the last iteration.
const EXACT: bool = cfg!(all(target_os = "linux", target_arch = "x86_64"));

/// Elsewhere the total may be off by this part of the steps, an iteration in every twentieth, and nothing else is
/// compared.
const BAND: f64 = 0.05;

/// One solver on one problem, its options besides the defaults, and its counts.
type Run = (&'static str, &'static [(&'static str, f64)], Counts);

/// Compares every run with its counts, and names all that differ.
fn assert_counts<Step>(problem: &str, steps: &[Step], view: impl Fn(&Step) -> StepView<'_>, runs: &[Run]) {
    let mut wrong = Vec::new();
    for &(name, options, frozen) in runs {
        let given = options.iter().fold(Options::new(), |given, &(option, value)| given.with(option, value));
        let mut solver = make_solver(name, &given).expect(name);
        let (mut system, mut counts) = (ConstrainedSystem::new(), Counts::default());
        for step in steps {
            system.assemble(&view(step)).expect("a good step");
            let mut x = vec![f64::NAN; system.len()];
            counts.add(&system.solve(&mut *solver, Wanted::Multipliers, &mut x).expect("good input"));
        }
        eprintln!(
            "{problem}: (\"{name}\", &{options:?}, Counts::new({}, {}, {}, {})),",
            counts.total, counts.most, counts.refreshes, counts.failures
        );
        let off = counts.total.abs_diff(frozen.total) as f64;
        let same = if EXACT { counts == frozen } else { off <= BAND * steps.len() as f64 };
        if !same {
            wrong.push(format!("{name} {options:?}: {counts:?}, frozen {frozen:?}"));
        }
    }
    assert!(!runs.is_empty() && wrong.is_empty(), "{problem}:\n{}", wrong.join("\n"));
}

/// 12 s of the boat at 1 ms along its prescribed motion.
#[test]
fn boat_of_12_000_steps() {
    let steps: Vec<_> = (0..12_000).map(|k| boat(1e-3 * f64::from(k))).collect();
    let runs: [Run; 9] = [
        ("sr1", &[], Counts::new(23_982, 3, 2, 0)),
        ("sr1-classic", &[], Counts::new(11_998, 1, 2, 0)),
        ("bfgs", &[], Counts::new(11_998, 1, 2, 0)),
        ("dfp", &[], Counts::new(11_998, 1, 2, 0)),
        ("sr1-tracked", &[("predict", 0.0)], Counts::new(23_967, 2, 2, 0)),
        ("sr1-tracked", &[("predict", 5.0)], Counts::new(2471, 2, 3, 0)),
        ("pinv-tracked", &[], Counts::new(12_369, 4, 6, 0)),
        ("cg", &[], Counts::new(23_999, 2, 0, 0)),
        ("minres", &[], Counts::new(23_999, 2, 0, 0)),
    ];
    assert_counts("boat", &steps, BoatStep::view, &runs);
}

/// 10 s of two four-bar loops at 1 ms along their branch, past the singular poses where two ranks are all but lost. One
/// solve of the carried inverses does not converge there.
#[test]
fn two_four_bar_loops_of_10_000_steps() {
    let times: Vec<_> = (0..10_000).map(|k| 1e-3 * f64::from(k)).collect();
    let states = trajectory(2, &times);
    let steps: Vec<_> =
        states.into_iter().map(|(theta, speed)| NFourBar::new(2, theta, speed, true)).collect();
    let runs: [Run; 9] = [
        ("sr1", &[], Counts::new(25_578, 4, 2, 1)),
        ("sr1-classic", &[], Counts::new(24_176, 3, 2, 1)),
        ("bfgs", &[], Counts::new(24_096, 3, 2, 1)),
        ("dfp", &[], Counts::new(24_081, 3, 2, 1)),
        ("sr1-tracked", &[("predict", 0.0)], Counts::new(26_482, 9, 11, 0)),
        ("sr1-tracked", &[("predict", 5.0)], Counts::new(9114, 9, 11, 0)),
        ("pinv-tracked", &[], Counts::new(10_547, 3, 12, 0)),
        ("cg", &[], Counts::new(39_874, 6, 0, 0)),
        ("minres", &[], Counts::new(39_881, 6, 0, 0)),
    ];
    assert_counts("two four-bar loops", &steps, NFourBar::view, &runs);
}
