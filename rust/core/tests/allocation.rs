//! After its set-up no solver allocates: counted by the allocator itself.

#![allow(unsafe_code)] // an allocator that counts must implement `GlobalAlloc`, which is unsafe

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::hint::black_box;

use oarlock_core::test_problems::{NV, ROWS, boat};
use oarlock_core::{
    ConstrainedSystem, Group, Inequalities, InequalityStep, MultiplierSolver, Options, SOLVERS, Wanted,
};

#[path = "core/support/tree.rs"]
#[allow(dead_code)]
mod tree;

thread_local! {
    /// Allocations of this thread; the test harness's own threads do not count.
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: hands every call on to the system's allocator unchanged; counting neither allocates nor unwinds.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.set(COUNT.get() + 1);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        unsafe { System.dealloc(memory, layout) }
    }

    // The default of `realloc` and `alloc_zeroed` goes through `alloc`, so they count too.
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(work: impl FnOnce()) -> usize {
    let before = COUNT.get();
    work();
    COUNT.get() - before
}

const WARM_UP: u32 = 2;
const ROUNDS: u32 = 100;

/// The boat's steps `from..to`: assemble, solve, back to accelerations.
fn run(solver: &mut dyn MultiplierSolver, system: &mut ConstrainedSystem, from: u32, to: u32) {
    let (mut x, mut qfrc, mut qacc) = ([0.0; ROWS], [0.0; NV], [0.0; NV]);
    for k in from..to {
        system.assemble(&boat(1e-3 * f64::from(k)).view()).expect("a good step");
        system.solve(solver, Wanted::Multipliers, &mut x).expect("a good system");
        system.acceleration(&x, &mut qfrc, &mut qacc).expect("matching lengths");
        black_box(&qacc);
    }
}

#[test]
fn the_counter_counts() {
    assert_eq!(allocations(|| drop(black_box(Box::new(1.0)))), 1);
    assert_eq!(allocations(|| drop(black_box(vec![0.0; 8]))), 1);
}

#[test]
fn no_solver_allocates_after_its_set_up() {
    assert!(!SOLVERS.is_empty());
    for kind in SOLVERS {
        let mut solver = (kind.build)(&Options::new()).expect(kind.name);
        let mut system = ConstrainedSystem::new();
        run(&mut *solver, &mut system, 0, WARM_UP);
        let count = allocations(|| run(&mut *solver, &mut system, WARM_UP, WARM_UP + ROUNDS));
        assert_eq!(count, 0, "allocations of {} in {ROUNDS} rounds", kind.name);
        // A refresh happens in the same workspace.
        solver.reset();
        assert_eq!(
            allocations(|| run(&mut *solver, &mut system, 0, 1)),
            0,
            "allocations of {} anew",
            kind.name
        );
    }
}

#[test]
fn sparse_steps_are_solved_without_allocating() {
    let shape = tree::Shape { nv: 30, spread: 4, loops: 9, sums: 2, copies: 3, consistent: true };
    let steps: Vec<_> = (0..20).map(|k| tree::TreeStep::random(7, shape, 1e-3 * f64::from(k))).collect();
    for name in ["auto", "primal", "dual"] {
        let mut solver = oarlock_core::make_solver(name, &Options::new()).expect(name);
        let (mut system, mut x) = (ConstrainedSystem::new(), [0.0; 14]);
        let mut walk = |steps: &[tree::TreeStep]| {
            for step in steps {
                system.assemble_sparse(&step.sparse()).expect("a good step");
                black_box(system.solve(&mut *solver, Wanted::Multipliers, &mut x).expect("a good system"));
            }
        };
        walk(&steps[..2]);
        assert_eq!(allocations(|| walk(&steps[2..])), 0, "allocations of {name}");
    }
}

/// The boat with friction loss on every velocity and up to as many limits, of which more or fewer are there.
fn run_rows(inequalities: &mut Inequalities, system: &mut ConstrainedSystem, from: u32, to: u32) {
    const MOST: usize = 2 * NV;
    let (mut jacobian, mut groups) = ([0.0; MOST * NV], [Group::Friction; MOST]);
    for row in 0..MOST {
        jacobian[row * NV + row % NV] = 1.0;
    }
    groups[NV..].fill(Group::Unilateral);
    for k in from..to {
        let m = MOST - (k as usize) % NV;
        let step = boat(1e-3 * f64::from(k));
        system.assemble(&step.view()).expect("a good step");
        let rows = InequalityStep {
            jacobian: &jacobian[..m * NV],
            aref: &[0.1; MOST][..m],
            stiffness: &[50.0; MOST][..m],
            friction_loss: &[0.5; MOST][..m],
            groups: &groups[..m],
        };
        let report = inequalities.solve(system, &rows, Some(&[0.1; NV]), None).expect("good rows");
        black_box(report);
        let mut start = [0.0; NV];
        start.copy_from_slice(system.unconstrained());
        system.renew(&start, step.view().aref).expect("finite");
        black_box(inequalities.certify(&[0.2; NV], &[0.3; MOST][..m]).expect("finite"));
    }
}

#[test]
fn inequality_rows_come_and_go_without_allocating() {
    let (mut inequalities, mut system) = (Inequalities::new(), ConstrainedSystem::new());
    run_rows(&mut inequalities, &mut system, 0, 40);
    let count = allocations(|| run_rows(&mut inequalities, &mut system, 40, 40 + ROUNDS));
    assert_eq!(count, 0, "allocations in {ROUNDS} rounds");
}
