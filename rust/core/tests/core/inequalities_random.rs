//! Random steps with friction loss, limits and contacts beside equality rows: every answer is proved, none is a panic.

use crate::support::assert_within;
use crate::support::contacts::{Touching, Whole};
use oarlock_core::test_problems::sequence::Random;
use oarlock_core::{ConstrainedSystem, Error, Group, Inequalities, Status};

/// Random steps of each kind.
const CASES: u64 = 2_000;

/// Relative error of accelerations and forces, in the norm of all of them: ε times the condition of M (1e4), and times the stiffness beside
/// the inertia where it is MuJoCo's (1e4 at most).
const ANSWER: f64 = 1e-8;

/// How exact rows are obeyed: the cut of the rank is 1e-5 of a row's length, and random rows come near it.
const OBEYED: f64 = 1e-5;

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn distance(x: &[f64], y: &[f64]) -> f64 {
    norm(&x.iter().zip(y).map(|(a, b)| a - b).collect::<Vec<_>>())
}

#[track_caller]
fn assert_proved(seed: u64, whole: &Whole) {
    assert_eq!(whole.report.status, Status::Converged, "{seed}: {:?}", whole.report);
    assert!(whole.certificate.holds(), "{seed}: {:?} {:?}", whole.certificate, whole.report);
}

#[test]
fn every_answer_is_proved_and_obeys_the_exact_rows() {
    let (mut iterations, mut most) = (0, 0);
    for seed in 0..CASES {
        let case = Touching::random(&mut Random::new(seed), -1.0, 4.0);
        let whole = case.solve(&mut Inequalities::new(), "auto", None);
        assert_proved(seed, &whole);
        iterations += whole.report.iterations;
        most = most.max(whole.report.iterations);
        if case.softness.is_none() {
            let nv = case.nv();
            let rows = case.equalities.chunks_exact(nv).zip(&case.wanted);
            for (row, wanted) in rows {
                let terms: f64 = row.iter().zip(&whole.qacc).map(|(a, b)| (a * b).abs()).sum();
                let rate: f64 = row.iter().zip(&whole.qacc).map(|(a, b)| a * b).sum();
                assert_within(
                    &format!("{seed}"),
                    (rate - wanted).abs(),
                    OBEYED * (terms + norm(&whole.qacc)),
                );
            }
        }
    }
    assert!(iterations as f64 <= 5.0 * CASES as f64 && most <= 80, "{iterations} in all, {most} at most");
}

#[test]
fn stiffness_of_any_size_ends_and_what_converged_is_proved() {
    // Up to 1e14 beside the inertia, where ε of a sum is 1 % of a force: some say so.
    let (mut open, mut most) = (0, 0);
    for seed in 0..CASES {
        let case = Touching::random(&mut Random::new(seed), -2.0, 10.0);
        let whole = case.solve(&mut Inequalities::new(), "auto", None);
        assert!(whole.forces.iter().chain(&whole.qacc).all(|entry| entry.is_finite()), "{seed}");
        most = most.max(whole.report.iterations);
        if whole.report.status == Status::Converged {
            assert_proved(seed, &whole);
        } else {
            open += 1;
        }
    }
    assert!(open <= CASES / 100 && most <= 300, "{open} not converged, {most} steps at most");
}

#[test]
fn a_start_changes_the_way_and_not_the_answer() {
    let (mut steps, mut most) = (0, 0);
    for seed in 0..CASES {
        let mut random = Random::new(seed);
        let case = Touching::random(&mut random, -1.0, 4.0);
        let cold = case.solve(&mut Inequalities::new(), "auto", None);
        let from: Vec<f64> = cold.qacc.iter().map(|a| a + random.uniform(-3.0, 3.0)).collect();
        let warm = case.solve(&mut Inequalities::new(), "auto", Some(&from));
        assert_proved(seed, &warm);
        assert_within(
            &format!("{seed}"),
            distance(&warm.qacc, &cold.qacc),
            ANSWER * (1.0 + norm(&cold.qacc)),
        );
        let again = case.solve(&mut Inequalities::new(), "auto", Some(&cold.qacc));
        steps += again.report.iterations;
        most = most.max(again.report.iterations);
    }
    // An acceleration is rounded, which the stiffest cones feel.
    assert!(steps as f64 <= 1.1 * CASES as f64 && most <= 10, "{steps} in all, {most} at most");
}

#[test]
fn the_order_of_the_rows_does_not_matter() {
    for seed in 0..CASES {
        let mut random = Random::new(seed);
        let case = Touching::random(&mut random, -1.0, 4.0);
        let (nv, count) = (case.nv(), case.groups.len());
        let mut order: Vec<usize> = (0..count).collect();
        (1..count).for_each(|i| order.swap(i, random.below(i + 1)));
        let firsts: Vec<usize> = case
            .groups
            .iter()
            .scan(0, |next, group| Some(std::mem::replace(next, *next + group.rows())))
            .collect();
        let mut turned = Touching {
            jacobian: vec![],
            aref: vec![],
            stiffness: vec![],
            loss: vec![],
            groups: vec![],
            ..case.clone()
        };
        for &group in &order {
            let rows = firsts[group]..firsts[group] + case.groups[group].rows();
            turned.jacobian.extend(&case.jacobian[rows.start * nv..rows.end * nv]);
            turned.aref.extend(&case.aref[rows.clone()]);
            turned.stiffness.extend(&case.stiffness[rows.clone()]);
            turned.loss.extend(&case.loss[rows]);
            turned.groups.push(case.groups[group]);
        }
        let one = case.solve(&mut Inequalities::new(), "auto", None);
        let other = turned.solve(&mut Inequalities::new(), "auto", None);
        assert_within(&format!("{seed}"), distance(&one.qacc, &other.qacc), ANSWER * (1.0 + norm(&one.qacc)));
    }
}

#[test]
fn every_equality_solver_gives_the_same_motion() {
    for seed in 0..CASES / 20 {
        let case = Touching::random(&mut Random::new(seed), -1.0, 4.0);
        let right = case.solve(&mut Inequalities::new(), "auto", None);
        for name in ["pinv", "svd", "cholesky", "sr1-tracked", "minres"] {
            let other = case.solve(&mut Inequalities::new(), name, None);
            if ["pinv", "svd"].contains(&name) {
                assert_proved(seed, &other);
            }
            let gap = distance(&other.qacc, &right.qacc);
            // What `converged` promises is relative to what a solver is asked, in which forces of the rows may be large.
            assert_within(&format!("{seed}, {name}"), gap, 1e3 * ANSWER * (1.0 + norm(&right.qacc)));
        }
    }
}

#[test]
fn a_system_that_lives_on_gives_the_answers_of_a_new_one_while_rows_come_and_go() {
    let (mut system, mut inequalities) = (ConstrainedSystem::new(), Inequalities::new());
    let mut random = Random::new(7);
    for seed in 0..CASES / 4 {
        let case = Touching::random(&mut random, -1.0, 4.0);
        let kept = case.solve_in(&mut system, &mut inequalities, "auto", None);
        let anew = case.solve(&mut Inequalities::new(), "auto", None);
        assert_eq!((kept.qacc, kept.forces), (anew.qacc, anew.forces), "{seed}, to the last bit");
    }
}

/// The objective of a step at an acceleration, written down anew, without the equality rows.
fn cost(case: &Touching, x: &[f64]) -> f64 {
    let (mut row, mut sum) = (0, 0.0);
    for group in &case.groups {
        let d = case.stiffness[row];
        sum += match group {
            Group::Friction => {
                let (x, loss) = (x[row].abs(), case.loss[row]);
                if d * x < loss { 0.5 * d * x * x } else { loss * x - 0.5 * loss * loss / d }
            }
            Group::Unilateral => 0.5 * d * x[row].min(0.0).powi(2),
            Group::Cone { dim, mu, friction } => {
                let normal = mu * x[row];
                let tangent = norm(&(1..*dim).map(|j| friction[j - 1] * x[row + j]).collect::<Vec<_>>());
                if normal >= mu * tangent {
                    0.0
                } else if mu * normal + tangent <= 0.0 {
                    (row..row + dim).map(|at| 0.5 * case.stiffness[at] * x[at] * x[at]).sum()
                } else {
                    0.5 * d / (mu * mu * (1.0 + mu * mu)) * (normal - mu * tangent).powi(2)
                }
            }
        };
        row += group.rows();
    }
    sum
}

#[test]
fn forces_are_the_slope_of_the_costs_and_the_answer_is_their_minimum() {
    // Central differences with a step of 1e-5 leave 1e-10 of a curvature of 1e4 and ε/1e-5 of the cost.
    const DIFFERENCE: f64 = 1e-5;
    for seed in 0..CASES {
        let mut random = Random::new(seed);
        let case = Touching::random(&mut random, -1.0, 2.0);
        let mut inequalities = Inequalities::new();
        let whole = case.solve(&mut inequalities, "auto", None);
        let x: Vec<f64> = case.rates(&whole.qacc).iter().zip(&case.aref).map(|(a, b)| a - b).collect();
        let scale = 1.0 + norm(&whole.forces);
        for row in 0..x.len() {
            let shifted = |by: f64| {
                let mut x = x.clone();
                x[row] += by;
                cost(&case, &x)
            };
            let slope = (shifted(DIFFERENCE) - shifted(-DIFFERENCE)) / (2.0 * DIFFERENCE);
            assert_within(
                &format!("{seed}, row {row}"),
                (slope + whole.forces[row]).abs(),
                1e-2 * scale * DIFFERENCE.sqrt(),
            );
        }
        // No lower along the null space of the exact rows: M a − f − Jᵀf is what equality rows bear, by their multipliers.
        let nv = case.nv();
        let mut left = case.needed(&whole.qacc);
        for (entry, force) in left.iter_mut().zip(inequalities.generalised_force()) {
            *entry -= force;
        }
        let size = norm(&left) + norm(&case.force) + norm(inequalities.generalised_force());
        for (row, multiplier) in case.equalities.chunks_exact(nv).zip(&whole.multipliers) {
            left.iter_mut().zip(row).for_each(|(left, entry)| *left -= entry * multiplier);
        }
        assert_within(&format!("{seed}"), norm(&left), ANSWER * size);
    }
}

#[test]
fn three_hundred_rows_of_contact_on_forty_velocities() {
    let mut random = Random::new(3);
    let mut case = Touching::random(&mut random, 0.0, 3.0);
    while case.nv() < 12 {
        case = Touching::random(&mut random, 0.0, 3.0);
    }
    while case.aref.len() < 300 {
        case.push_random(&mut random, 0.0, 3.0);
    }
    for softness in [None, Some(vec![1e-3; case.wanted.len()])] {
        case.softness = softness;
        let cold = case.solve(&mut Inequalities::new(), "auto", None);
        assert_proved(3, &cold);
        assert!(cold.report.iterations <= 25, "{:?}", cold.report);
        let again = case.solve(&mut Inequalities::new(), "auto", Some(&cold.qacc));
        assert!(again.report.iterations <= 2, "{:?}", again.report);
    }
}

#[test]
fn numbers_that_are_none_are_refused_and_leave_the_solver_usable() {
    let good = Touching::random(&mut Random::new(11), -1.0, 4.0);
    let mut inequalities = Inequalities::new();
    let right = good.solve(&mut inequalities, "auto", None).forces;
    let mut system = ConstrainedSystem::new();
    system.assemble(&good.smooth()).expect("good");
    let refused = |case: &Touching, system: &mut ConstrainedSystem, inequalities: &mut Inequalities| {
        inequalities.solve(system, &case.rows(), None, None).expect_err("bad rows")
    };
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let spoilt: [fn(&mut Touching) -> &mut Vec<f64>; 3] =
            [|case| &mut case.jacobian, |case| &mut case.aref, |case| &mut case.stiffness];
        for field in spoilt {
            let mut case = good.clone();
            field(&mut case)[0] = bad;
            assert!(matches!(refused(&case, &mut system, &mut inequalities), Error::NonFinite { .. }));
        }
        let start = vec![bad; good.nv()];
        let error = inequalities.solve(&mut system, &good.rows(), Some(&start), None).expect_err("bad start");
        assert!(matches!(error, Error::NonFinite { what: "near", .. }));
    }
    let mut case = good.clone();
    case.groups.pop();
    assert!(matches!(refused(&case, &mut system, &mut inequalities), Error::Shape { .. }));
    let mut case = good.clone();
    case.stiffness[0] = 0.0;
    assert!(matches!(refused(&case, &mut system, &mut inequalities), Error::Range { what: "stiffness", .. }));
    let mut case = good.clone();
    case.push(Group::Friction, &vec![1.0; good.nv()], &[0.0], 1.0, -1.0);
    assert!(matches!(
        refused(&case, &mut system, &mut inequalities),
        Error::Range { what: "friction_loss", .. }
    ));
    for (dim, mu, friction, what) in
        [(3, 0.0, 1.0, "mu"), (3, 1.0, -1.0, "friction"), (7, 1.0, 1.0, "dim"), (usize::MAX, 1.0, 1.0, "dim")]
    {
        let mut case = good.clone();
        case.groups.push(Group::Cone { dim, mu, friction: [friction; 5] });
        let rows = dim.min(7);
        case.jacobian.extend(vec![1.0; rows * good.nv()]);
        for field in [&mut case.aref, &mut case.stiffness, &mut case.loss] {
            field.extend(vec![1.0; rows]);
        }
        let error = refused(&case, &mut system, &mut inequalities);
        assert!(matches!(error, Error::Range { what: got, .. } if got == what), "{error}");
    }
    for huge in [1e160, 1e308] {
        let mut case = good.clone();
        case.jacobian.iter_mut().for_each(|entry| *entry *= huge);
        refused(&case, &mut system, &mut inequalities);
    }
    assert_eq!(good.solve(&mut inequalities, "auto", None).forces, right);
    let empty = inequalities.solve(&mut ConstrainedSystem::new(), &good.rows(), None, None);
    assert!(matches!(empty, Err(Error::Empty { .. })));
}

#[test]
fn no_rows_cost_nothing_and_push_nothing() {
    let case = Touching {
        groups: vec![],
        aref: vec![],
        stiffness: vec![],
        loss: vec![],
        jacobian: vec![],
        ..Touching::random(&mut Random::new(5), 0.0, 1.0)
    };
    let whole = case.solve(&mut Inequalities::new(), "auto", None);
    assert_eq!((whole.report.active, whole.report.iterations, whole.report.coordinates), (0, 0, 0));
    assert!(whole.certificate.holds());
}

/// Numbers at the ends of what there is.
const WILD: [f64; 16] = [
    0.0,
    -0.0,
    1.0,
    1e-8,
    -1e8,
    1e-150,
    1e150,
    -1e150,
    1e-200,
    1e200,
    -1e300,
    1e-308,
    5e-324,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
];

#[test]
fn wild_numbers_are_an_error_or_a_finite_answer_and_leave_nothing_behind() {
    let (mut answered, mut refused) = (0, 0);
    let (mut system, mut inequalities) = (ConstrainedSystem::new(), Inequalities::new());
    let good = Touching::random(&mut Random::new(1), -1.0, 4.0);
    let right = good.solve(&mut Inequalities::new(), "auto", None).forces;
    for seed in 0..5 * CASES {
        let mut random = Random::new(seed);
        let mut case = Touching::random(&mut random, -1.0, 4.0);
        for _ in 0..=random.below(3) {
            let value = WILD[random.below(WILD.len())];
            let field = match random.below(9) {
                0 => &mut case.force,
                1 => &mut case.equalities,
                2 => &mut case.wanted,
                3 | 4 => &mut case.jacobian,
                5 | 6 => &mut case.aref,
                7 => &mut case.stiffness,
                _ => &mut case.loss,
            };
            let at = random.below(field.len());
            field[at] = value;
        }
        if let Some(Group::Cone { mu, friction, .. }) = case.groups.last_mut()
            && random.one_in(4)
        {
            *if random.one_in(2) { mu } else { &mut friction[0] } = WILD[random.below(WILD.len())];
        }
        if system.assemble(&case.smooth()).is_err() {
            continue;
        }
        let start: Vec<f64> = (0..case.nv()).map(|_| WILD[random.below(WILD.len())]).collect();
        let start = Some(start.as_slice()).filter(|_| random.one_in(2));
        match inequalities.solve(&mut system, &case.rows(), start, None) {
            Ok(report) => {
                let forces = inequalities.forces().to_vec();
                let all = forces.iter().chain(inequalities.generalised_force());
                assert!(all.clone().all(|entry| entry.is_finite()), "{seed}: {report:?}");
                // Accelerations of any size: a certificate or an error.
                let _ = inequalities.certify(&case.force, &forces);
                answered += 1;
            }
            Err(_) => refused += 1,
        }
        if seed % 50 == 0 {
            assert_eq!(good.solve_in(&mut system, &mut inequalities, "auto", None).forces, right, "{seed}");
        }
    }
    assert!(answered > CASES && refused > CASES, "{answered} answered, {refused} refused");
}
