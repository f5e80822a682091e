//! Sparse steps: the same answers as dense ones, by every method, with the rank that eigenvalues say.

use crate::support::tree::{Shape, TreeStep};
use crate::support::{assert_within, matrix_of, solve, solver};
use nalgebra::DVector;
use oarlock_core::{
    ConstrainedSystem, Error, Info, JacobianView, Options, SparseStep, TreeView, make_solver,
};

/// Relative error of λ and a at conditions of A up to 1e6, which rows of random entries on deep trees have: what rows contradict one
/// another by stands beside it, as much larger.
const SOLVED: f64 = 1e-8;

/// Chains, bushes, redundancy that folds and that does not, rows that contradict one another, velocities that no row touches.
fn shapes() -> Vec<Shape> {
    let shape =
        |nv, spread, loops, sums, copies, consistent| Shape { nv, spread, loops, sums, copies, consistent };
    vec![
        shape(12, 1, 5, 0, 0, true),
        shape(30, 3, 9, 0, 6, true),
        shape(30, 30, 12, 4, 0, true),
        shape(40, 2, 20, 6, 5, false),
        shape(60, 5, 24, 10, 0, true),
        shape(25, 25, 40, 0, 0, true),
        shape(9, 9, 3, 8, 8, false),
    ]
}

/// λ, a and figures of a sparse step.
fn solved(
    name: &str,
    system: &mut ConstrainedSystem,
    step: &SparseStep<'_>,
) -> (DVector<f64>, DVector<f64>, Info) {
    system.assemble_sparse(step).expect("a good step");
    let (x, info) = solve(&mut *solver(name), system);
    let (mut qfrc, mut qacc) = (DVector::zeros(system.nv()), DVector::zeros(system.nv()));
    system.acceleration(x.as_slice(), qfrc.as_mut_slice(), qacc.as_mut_slice()).expect("matching lengths");
    (x, qacc, info)
}

#[test]
fn every_method_gives_the_minimum_norm_and_the_rank_that_eigenvalues_give() {
    for seed in 0..40 {
        for shape in shapes() {
            let step = TreeStep::random(seed, shape, 0.0);
            let mut dense = ConstrainedSystem::new();
            dense.assemble(&step.dense()).expect("a good step");
            let (x, said) = solve(&mut *solver("pinv"), &mut dense);
            if said.margin.is_some_and(|margin| margin < 1e4) {
                continue; // hardly a rank
            }
            let (mut qfrc, mut qacc) = (DVector::zeros(shape.nv), DVector::zeros(shape.nv));
            dense.acceleration(x.as_slice(), qfrc.as_mut_slice(), qacc.as_mut_slice()).expect("lengths");
            for name in ["auto", "primal", "dual", "cholesky", "pinv"] {
                let what = format!("{name}, {seed}, {shape:?}");
                let (multipliers, acceleration, info) =
                    solved(name, &mut ConstrainedSystem::new(), &step.sparse());
                assert_eq!(info.rank, said.rank, "{what}");
                assert_within(&what, (multipliers - &x).norm(), SOLVED * x.norm());
                assert_within(&what, (acceleration - &qacc).norm(), SOLVED * qacc.norm());
                let (apart, expected) =
                    (info.inconsistency.expect("known"), said.inconsistency.expect("known"));
                assert_within(
                    &what,
                    (apart - expected).abs(),
                    SOLVED * dense.rhs().iter().map(|b| b.abs()).sum::<f64>(),
                );
                assert_within(&what, info.residual_rel, SOLVED);
            }
        }
    }
}

#[test]
fn sparse_methods_answer_themselves_where_their_evidence_holds() {
    let (mut primal, mut dual) = (0, 0);
    for seed in 0..40 {
        for shape in shapes() {
            let step = TreeStep::random(seed, shape, 0.0);
            let answered =
                |name| solved(name, &mut ConstrainedSystem::new(), &step.sparse()).2.fallbacks == 0;
            primal += usize::from(answered("primal"));
            let independent = shape.sums == 0 && shape.loops < shape.nv;
            let by_dual = answered("dual");
            assert!(independent || !by_dual, "{seed}, {shape:?}: dependent rows have no factor");
            dual += usize::from(by_dual);
        }
    }
    // Loops that pick one velocity twice may be dependent by chance; conditions beyond 1e8 leave the rank open.
    assert!(primal > 270 && dual > 60, "{primal} and {dual} of 280");
}

/// Beyond two dozen rows they invert A by a sparse factor where that proves its rank; a decomposition says what they then carry else.
#[test]
fn quasi_newton_methods_start_from_the_inverse_that_eigenvalues_give() {
    let mut regular = [0, 0];
    for (seed, sums) in (0..12).flat_map(|seed| [(seed, 0), (seed, 8)]) {
        let shape = Shape { nv: 150, spread: 3, loops: 40, sums, copies: 0, consistent: true };
        let step = TreeStep::random(seed, shape, 0.0);
        let (x, _, said) = solved("pinv", &mut ConstrainedSystem::new(), &step.sparse());
        for name in ["sr1-tracked", "sr1", "bfgs"] {
            let (multipliers, _, info) = solved(name, &mut ConstrainedSystem::new(), &step.sparse());
            let what = format!("{name}, {seed}, {sums}");
            assert!(info.refreshed, "{what}");
            assert_within(&what, (multipliers - &x).norm(), SOLVED * x.norm());
            if name == "sr1-tracked" {
                assert_eq!(info.rank, said.rank, "{what}");
                regular[usize::from(sums > 0)] += usize::from(info.rank == Some(shape.loops + shape.sums));
            }
        }
    }
    // Loops that pick one velocity twice may be dependent by chance.
    assert!(regular[0] > 4 && regular[1] == 0, "{regular:?}");
}

#[test]
fn dense_and_compressed_rows_give_the_same_answers() {
    for name in ["auto", "primal", "dual", "sr1-tracked"] {
        let shape = shapes()[2];
        let (mut one, mut other) = (ConstrainedSystem::new(), ConstrainedSystem::new());
        let (mut solvers, mut answers) = ([solver(name), solver(name)], [vec![0.0; 16], vec![0.0; 16]]);
        for moved in 0..5 {
            let step = TreeStep::random(3, shape, 1e-3 * f64::from(moved));
            one.assemble_sparse(&step.sparse()).expect("good");
            other.assemble_sparse(&step.sparse_of_dense()).expect("good");
            for (system, (solver, answer)) in
                [&mut one, &mut other].into_iter().zip(solvers.iter_mut().zip(&mut answers))
            {
                system.solve(&mut **solver, oarlock_core::Wanted::Multipliers, answer).expect("good");
            }
            // Zeros in a pattern change the order of elimination, and so the last bits.
            let [one, other] = answers.each_ref().map(|answer| DVector::from_column_slice(answer));
            assert_within(&format!("{name}, step {moved}"), (&one - &other).norm(), SOLVED * other.norm());
        }
    }
}

#[test]
fn rows_that_come_to_touch_more_are_planned_anew() {
    let shape = shapes()[1];
    let (mut system, mut primal) = (ConstrainedSystem::new(), solver("primal"));
    let mut answer = vec![0.0; 15];
    // Another seed has its loops elsewhere on another tree.
    for seed in [1, 1, 2, 1] {
        let step = TreeStep::random(seed, shape, 0.0);
        system.assemble_sparse(&step.sparse()).expect("good");
        system.solve(&mut *primal, oarlock_core::Wanted::Multipliers, &mut answer).expect("good");
        let (x, ..) = solved("pinv", &mut ConstrainedSystem::new(), &step.sparse());
        assert_within("λ", (DVector::from_column_slice(&answer) - &x).norm(), SOLVED * x.norm());
    }
}

#[test]
fn a_of_a_sparse_step_is_that_of_the_dense_one() {
    let step = TreeStep::random(5, shapes()[3], 0.0);
    let (mut sparse, mut dense) = (ConstrainedSystem::new(), ConstrainedSystem::new());
    sparse.assemble_sparse(&step.sparse()).expect("good");
    dense.assemble(&step.dense()).expect("good");
    let (a, b) = (matrix_of(&sparse), matrix_of(&dense));
    assert_within("A", (&a - &b).norm(), 1e-13 * b.norm());
    // Blocks of a sparse step are those of the pattern, which exact zeros do not take apart.
    assert!(sparse.blocks().len() <= dense.blocks().len());
}

#[test]
fn loops_on_trees_of_their_own_are_blocks_of_their_own() {
    let (nv, loops) = (12, 4);
    let entries: Vec<f64> =
        (0..loops).flat_map(|row| (0..nv).map(move |at| f64::from(u8::from(at / 3 == row)))).collect();
    let ones = vec![1.0; nv];
    let numbers: Vec<i32> = (0..12).collect();
    let step = SparseStep {
        jacobian: JacobianView::Dense(&entries),
        inertia: TreeView {
            lengths: &[1; 12],
            starts: &numbers,
            columns: &numbers,
            mass: &ones,
            factor: &ones,
            inverse_diagonal: &ones,
        },
        unconstrained: &ones,
        aref: &[0.0; 4],
        regularisation: None,
    };
    for name in ["dual", "primal", "auto"] {
        let mut system = ConstrainedSystem::new();
        let (x, _, info) = solved(name, &mut system, &step);
        assert_eq!((system.blocks().len(), info.rank), (4, Some(4)));
        assert!(x.iter().all(|force| (force + 1.0).abs() < 1e-14), "{name}: {x}");
    }
}

#[test]
fn redundant_rows_that_stand_open_are_dropped_as_eigenvalues_drop_them() {
    let shape = Shape { nv: 40, spread: 3, loops: 12, sums: 4, copies: 0, consistent: true };
    for (seed, gap) in (0..40).flat_map(|seed| [1e-9, 1e-8, 1e-7, 1e-6, 1e-5].map(|gap| (seed, gap))) {
        let closed = TreeStep::random(seed, shape, 0.0);
        let open = closed.clone().opened(4, gap);
        let [answer, expected] = ["auto", "pinv"].map(|name| {
            let (mut system, mut solver) = (ConstrainedSystem::new(), solver(name));
            let mut solve_at = |step: &TreeStep, gap: f64| {
                system.hold_rank(&[gap; 16]);
                system.assemble_sparse(&step.sparse()).expect("good");
                solve(&mut *solver, &mut system)
            };
            solve_at(&closed, 1e-15);
            solve_at(&open, gap)
        });
        assert_eq!(answer.1.rank, expected.1.rank, "{seed}, {gap}");
        assert_within(
            &format!("λ, {seed}, {gap}"),
            (&answer.0 - &expected.0).norm(),
            SOLVED * expected.0.norm(),
        );
    }
}

/// The cut of the test below: an eigenvector there turns by a rounding error over it.
const CUT: f64 = 1e-6;

#[test]
fn a_few_eigenvalues_near_the_cut_are_told_apart_as_all_eigenvalues_tell_them() {
    let shape = Shape { nv: 60, spread: 3, loops: 24, sums: 4, copies: 0, consistent: false };
    let mut told = 0;
    for (seed, turned) in (0..40).flat_map(|seed| [1e-3, 3e-3, 1e-2, 3e-2].map(|turned| (seed, turned))) {
        let (before, here) =
            (TreeStep::random(seed, shape, 0.0).opened(4, 0.5), TreeStep::random(seed, shape, 0.0));
        let here = here.opened(4, turned);
        let [answer, expected] = ["dual", "pinv"].map(|name| {
            let options = Options::new().with("rank_cut", CUT);
            let (mut system, mut solver) =
                (ConstrainedSystem::new(), make_solver(name, &options).expect(name));
            let mut solve_at = |step: &TreeStep| {
                system.hold_rank(&[0.0; 28]);
                system.assemble_sparse(&step.sparse()).expect("good");
                solve(&mut *solver, &mut system)
            };
            solve_at(&before);
            solve_at(&here)
        });
        if expected.1.margin.is_some_and(|margin| margin < 1.1) {
            continue; // rounding decides
        }
        let what = format!("{seed}, {turned}: {:?}", answer.1);
        assert_eq!(answer.1.rank, expected.1.rank, "{what}");
        assert_within(&what, (&answer.0 - &expected.0).norm(), SOLVED * expected.0.norm());
        // Pivots of the dense method that is behind it say no margin.
        told += usize::from(answer.1.margin.is_some());
    }
    assert!(told > 10, "{told}");
}

/// A chain of two links whose end is held: stretched at φ = 0, where a row vanishes against the others.
fn stretched(angle: f64) -> (Vec<f64>, Vec<f64>) {
    let (sin, cos) = angle.sin_cos();
    let mut rows = vec![0.0; 8 * 12];
    for pair in 0..4 {
        let at = 3 * pair;
        rows[2 * pair * 12 + at] = 1.0;
        rows[2 * pair * 12 + at + 1] = 0.5;
        rows[(2 * pair + 1) * 12 + at] = cos;
        rows[(2 * pair + 1) * 12 + at + 1] = 0.5 * cos + sin;
    }
    (rows, vec![0.3; 8])
}

#[test]
fn ranks_near_the_cut_are_left_to_eigenvalues() {
    let ones = vec![1.0; 12];
    let numbers: Vec<i32> = (0..12).collect();
    for (angle, rank) in [(0.3, 8), (1e-3, 8), (1e-5, 4), (1e-8, 4), (0.0, 4)] {
        let (rows, aref) = stretched(angle);
        let inertia = TreeView {
            lengths: &[1; 12],
            starts: &numbers,
            columns: &numbers,
            mass: &ones,
            factor: &ones,
            inverse_diagonal: &ones,
        };
        let jacobian = JacobianView::Dense(&rows);
        let step = SparseStep { jacobian, inertia, unconstrained: &ones, aref: &aref, regularisation: None };
        for name in ["auto", "pinv"] {
            let info = solved(name, &mut ConstrainedSystem::new(), &step).2;
            assert_eq!(info.rank, Some(rank), "{name} at {angle}");
        }
        // Along a path the rank of the first, open pose is held from above, and lost at the stretched one.
        let mut system = ConstrainedSystem::new();
        let mut auto = solver("auto");
        for (along, expected) in [(0.3, 8), (angle, rank), (0.2, 8)] {
            let (rows, aref) = stretched(along);
            let step = SparseStep { jacobian: JacobianView::Dense(&rows), aref: &aref, ..step };
            system.hold_rank(&[1e-15; 8]);
            system.assemble_sparse(&step).expect("good");
            let (_, info) = solve(&mut *auto, &mut system);
            assert_eq!((info.rank, info.risen), (Some(expected), false), "held, at {along}");
        }
    }
}

#[test]
fn what_does_not_fit_together_is_refused_by_name_and_leaves_the_step() {
    let step = TreeStep::random(1, shapes()[0], 0.0);
    let good = step.sparse();
    let mut system = ConstrainedSystem::new();
    system.assemble_sparse(&good).expect("good");
    let before = system.rhs().to_vec();
    let JacobianView::Compressed { lengths, starts, columns, values } = good.jacobian else {
        panic!("compressed")
    };
    let mut falling = columns.to_vec();
    falling.swap(0, 1);
    let mut wide = columns.to_vec();
    *wide.last_mut().expect("entries") = 12;
    let mut infinite = values.to_vec();
    infinite[1] = f64::INFINITY;
    let bad_rows = [
        (JacobianView::Compressed { lengths, starts, columns: &falling, values }, "jacobian"),
        (JacobianView::Compressed { lengths, starts, columns: &wide, values }, "jacobian"),
        (JacobianView::Compressed { lengths: &lengths[1..], starts, columns, values }, "jacobian rows"),
        (JacobianView::Compressed { lengths, starts, columns: &columns[1..], values }, "jacobian"),
        (JacobianView::Compressed { lengths, starts, columns, values: &infinite }, "jacobian"),
    ];
    for (jacobian, name) in bad_rows {
        let error = system.assemble_sparse(&SparseStep { jacobian, ..good }).expect_err("bad rows");
        assert!(error.to_string().contains(name), "{error}");
    }
    let tree = good.inertia;
    let shifted: Vec<i32> = tree.starts.iter().map(|start| start + 1).collect();
    let inertia = TreeView { starts: &shifted, ..tree };
    assert_eq!(system.assemble_sparse(&SparseStep { inertia, ..good }), Err(Error::Pattern { what: "mass" }));
    let mut none = tree.inverse_diagonal.to_vec();
    none[3] = f64::NAN;
    let inertia = TreeView { inverse_diagonal: &none, ..tree };
    let error = system.assemble_sparse(&SparseStep { inertia, ..good }).expect_err("a NaN");
    assert!(matches!(error, Error::NonFinite { what: "inverse diagonal", index: 3, .. }), "{error}");
    assert_eq!(system.rhs(), before);
}
