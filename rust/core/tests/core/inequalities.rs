//! Friction loss, limits and contacts where the answer is known in closed form.

use crate::support::contacts::{Touching, Whole};
use crate::support::{ROUNDING, assert_within};
use oarlock_core::inequalities::Piece;
use oarlock_core::{ConstrainedSystem, Error, Group, Inequalities, Info, Status};

/// Relative error of a force: products of a few sums, times D over what the inertia asks for, which is 1e3 at most here.
const FORCE: f64 = 1e-12;

fn solve(case: &Touching) -> (Whole, Inequalities) {
    let mut inequalities = Inequalities::new();
    let whole = case.solve(&mut inequalities, "auto", None);
    assert_eq!(whole.report.status, Status::Converged);
    assert!(whole.certificate.holds(), "{:?}", whole.certificate);
    (whole, inequalities)
}

#[track_caller]
fn assert_near(got: f64, right: f64) {
    assert_within(&format!("{got} is not {right}"), (got - right).abs(), FORCE * right.abs().max(1.0));
}

/// A mass of 2 kg on the first of two velocities, and an equality row on the second, of 3 kg, that asks for 5.
fn block(force: f64) -> Touching {
    Touching {
        mass: vec![2.0, 0.0, 0.0, 3.0],
        force: vec![force, 1.0],
        equalities: vec![0.0, 1.0],
        wanted: vec![5.0],
        ..Touching::default()
    }
}

#[test]
fn a_block_on_a_stop_is_held_as_its_softness_says() {
    let mut case = block(-30.0);
    case.push(Group::Unilateral, &[1.0, 0.0], &[4.0], 100.0, 0.0);
    let (whole, inequalities) = solve(&case);
    // f = D (aref − a) and 2 a = −30 + f.
    let force = (4.0 + 15.0) / (0.01 + 0.5);
    assert_near(whole.forces[0], force);
    assert_near(whole.qacc[0], (force - 30.0) / 2.0);
    assert_near(whole.qacc[1], 5.0);
    assert_near(whole.multipliers[0], 14.0);
    assert_eq!(inequalities.pieces(), [Piece::On]);
    assert_eq!((whole.report.iterations, whole.report.coordinates, whole.report.active), (1, 1, 1));

    let mut free = block(30.0);
    free.push(Group::Unilateral, &[1.0, 0.0], &[4.0], 100.0, 0.0);
    let (whole, inequalities) = solve(&free);
    assert_eq!((whole.forces[0], inequalities.pieces()[0]), (0.0, Piece::Free));
    assert_eq!((whole.report.iterations, whole.report.active), (0, 0));
    assert_near(whole.qacc[0], 15.0);
}

#[test]
fn friction_loss_holds_up_to_its_threshold_and_no_further() {
    // Stuck, x = a − aref = f_smooth/m − aref by way of f: |f| = (|a₀ − aref|)/(R + 1/m) against η.
    let (stiffness, aref): (f64, f64) = (50.0, 0.25);
    for (push, loss) in [(4.0, 5.0), (-4.0, 5.0), (12.0, 5.0), (-12.0, 5.0), (12.0, 0.0)] {
        let mut case = block(push);
        case.push(Group::Friction, &[1.0, 0.0], &[aref], stiffness, loss);
        let (whole, inequalities) = solve(&case);
        let held = -(push / 2.0 - aref) / (1.0 / stiffness + 0.5);
        let expected = held.clamp(-loss, loss);
        assert_near(whole.forces[0], expected);
        let piece = match (held.abs() < loss, push > 0.0) {
            (true, _) => Piece::Stick,
            (false, true) => Piece::SlipForward,
            (false, false) => Piece::SlipBackward,
        };
        assert_eq!(inequalities.pieces(), [piece], "{push} N against {loss} N");
        assert_near(2.0 * whole.qacc[0], push + expected);
    }
}

/// A block of 2 kg on a slope of 30°, its coordinates along and into the slope (up), and a slide of 1 kg that an equality row holds.
fn slope(tilt: f64) -> Touching {
    let weight = 2.0 * 9.81;
    Touching {
        mass: [[2.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
            .concat(),
        force: vec![weight * tilt.sin(), 0.0, -weight * tilt.cos(), 3.0],
        equalities: vec![0.0, 0.0, 0.0, 1.0],
        wanted: vec![0.0],
        ..Touching::default()
    }
}

const NORMAL: [f64; 4] = [0.0, 0.0, 1.0, 0.0];
const ALONG: [f64; 4] = [1.0, 0.0, 0.0, 0.0];
const ACROSS: [f64; 4] = [0.0, 1.0, 0.0, 0.0];

#[test]
fn a_block_on_a_slope_sticks_below_the_friction_angle_and_slides_above_it() {
    // MuJoCo's cone in the stiff limit: forces within friction, normal force what holds the block. D as MuJoCo makes it, R of a tenth
    // of the inertia; the friction rows get theirs from the cone.
    let stiffness = 2.0 * 1e4;
    for (degrees, slides) in [(10.0_f64, false), (25.0, false), (40.0, true)] {
        let tilt = degrees.to_radians();
        let mut case = slope(tilt);
        let friction = [0.6, 0.6, 0.01, 0.01, 0.01];
        let group = Group::Cone { dim: 3, mu: 0.6, friction };
        case.push(group, &[NORMAL, ALONG, ACROSS].concat(), &[0.0; 3], stiffness, 0.0);
        let (whole, inequalities) = solve(&case);
        let piece = if slides { Piece::Slide } else { Piece::Stick };
        assert_eq!(inequalities.pieces(), [piece; 3], "{degrees}°");
        let weight = 2.0 * 9.81;
        if slides {
            // On the middle piece f is on the cone: friction is 0.6 times the normal force, against the slope.
            assert_near(-whole.forces[1] / whole.forces[0], 0.6);
            // f₀ = −D_m μ v with v = μ x₀ − μ T, T = 0.6 (a along): two linear equations.
            let sliding = stiffness / (0.36 * 1.36);
            let (a0, b0) = (-9.81 * tilt.cos(), 9.81 * tilt.sin());
            // x₀ = a0 + f₀/2, x₁ = b0 − 0.6 f₀/2, v = 0.6 x₀ − 0.36 x₁, f₀ = −0.6 D_m v.
            let force = -0.6 * sliding * (0.6 * a0 - 0.36 * b0) / (1.0 + 0.6 * sliding * (0.3 + 0.36 * 0.3));
            assert_near(whole.forces[0], force);
        } else {
            assert_near(whole.forces[0], weight * tilt.cos() / (1.0 + 2.0 / stiffness));
            assert_near(whole.forces[1], -weight * tilt.sin() / (1.0 + 2.0 / stiffness));
        }
        assert_within("across", whole.forces[2].abs(), ROUNDING * weight);
    }
}

#[test]
fn a_pyramid_along_the_slope_is_a_cone_of_edges() {
    let (mu, tilt) = (0.6, 40.0_f64.to_radians());
    let mut case = slope(tilt);
    for (tangent, sign) in [(ALONG, 1.0), (ALONG, -1.0), (ACROSS, 1.0), (ACROSS, -1.0)] {
        let edge: Vec<f64> = NORMAL.iter().zip(tangent).map(|(n, t)| n + sign * mu * t).collect();
        case.push(Group::Unilateral, &edge, &[0.0], 1e4, 0.0);
    }
    let (whole, inequalities) = solve(&case);
    // The edge against the slope pushes alone: what it pushes away from the slope lets the edges across go.
    assert_eq!(inequalities.pieces(), [Piece::Free, Piece::On, Piece::Free, Piece::Free]);
    // x₁ = n − μ s with n = a0 + f/2, s = b0 − μ f/2; f = −D x₁.
    let (normal, along) = (-9.81 * tilt.cos(), 9.81 * tilt.sin());
    assert_near(whole.forces[1], (mu * along - normal) / (1e-4 + 0.5 + mu * mu / 2.0));
    let mut flat = slope(0.0);
    for (tangent, sign) in [(ALONG, 1.0), (ALONG, -1.0), (ACROSS, 1.0), (ACROSS, -1.0)] {
        let edge: Vec<f64> = NORMAL.iter().zip(tangent).map(|(n, t)| n + sign * mu * t).collect();
        flat.push(Group::Unilateral, &edge, &[0.0], 1e4, 0.0);
    }
    // Four edges share the weight, each of softness R.
    let (whole, _) = solve(&flat);
    whole.forces.iter().for_each(|&force| assert_near(force, 9.81 / (1e-4 + 2.0)));
}

#[test]
fn a_limit_that_an_exact_loop_fights_is_blocked_and_named() {
    // The second velocity is held by the loop at 5; a limit asks for 7 of it, and another limit acts on the first.
    let mut case = block(-30.0);
    case.push(Group::Unilateral, &[1.0, 0.0], &[4.0], 100.0, 0.0);
    case.push(Group::Unilateral, &[0.0, 1.0], &[7.0], 10.0, 0.0);
    case.push(Group::Unilateral, &[0.0, 2.0], &[9.0], 10.0, 0.0);
    let (whole, inequalities) = solve(&case);
    assert_eq!(inequalities.blocked(), [1]);
    assert_eq!(whole.report.blocked, 1, "the third row is satisfied");
    // It pushes as its law says, and the loop bears it.
    assert_near(whole.forces[1], 20.0);
    assert_near(whole.multipliers[0], 14.0 - 20.0);
    assert_near(whole.qacc[1], 5.0);
    assert_near(whole.forces[0], (4.0 + 15.0) / (0.01 + 0.5));
    // A soft loop gives way, and nothing is blocked.
    case.softness = Some(vec![0.1]);
    let (whole, inequalities) = solve(&case);
    assert!(inequalities.blocked().is_empty());
    // 3 a = 1 + λ + f + 2 g: λ = 10 (5 − a), f = 10 (7 − a), g = 10 max(9 − 2 a, 0) = 0 at a > 4.5.
    let a = (1.0 + 50.0 + 70.0) / 23.0;
    assert_near(whole.qacc[1], a);
    assert_near(whole.forces[1], 10.0 * (7.0 - a));
}

#[test]
fn exact_rows_that_say_the_same_or_contradict_one_another_hold_by_least_squares() {
    let mut case = block(-30.0);
    case.equalities = vec![0.0, 1.0, 0.0, 2.0, 0.3, 1.0];
    // The first two say 5 and 4: least squares of the folded row, (5 + 2·8)/5.
    case.wanted = vec![5.0, 8.0, 1.0];
    case.push(Group::Unilateral, &[1.0, 0.0], &[4.0], 100.0, 0.0);
    let (whole, inequalities) = solve(&case);
    assert_near(whole.qacc[1], 21.0 / 5.0);
    assert_near(whole.qacc[0], (1.0 - 21.0 / 5.0) / 0.3);
    assert_eq!((inequalities.blocked(), whole.report.coordinates), (&[0][..], 0));
}

#[test]
fn blocks_that_no_row_touches_take_no_part() {
    let mut case = Touching {
        mass: vec![0.0; 36],
        force: vec![1.0, -2.0, 3.0, -4.0, 5.0, -6.0],
        equalities: [[1.0, 1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]].concat(),
        wanted: vec![0.0, 0.0],
        ..Touching::default()
    };
    (0..6).for_each(|i| case.mass[7 * i] = 1.0);
    case.push(Group::Unilateral, &[0.0, 0.0, 0.0, 0.0, 1.0, 0.0], &[9.0], 1.0, 0.0);
    assert_eq!(solve(&case).0.report.coordinates, 1);
    case.push(Group::Unilateral, &[0.0, 0.0, 1.0, 0.0, 0.0, 0.0], &[9.0], 1.0, 0.0);
    let (whole, _) = solve(&case);
    assert_eq!(whole.report.coordinates, 2, "one is left of the second block");
    // x = z/√2 from (3 + 4)/2: f = (9 − 3.5)/(1 + ½).
    assert_near(whole.forces[1], 5.5 / 1.5);
}

#[test]
fn a_start_at_the_answer_is_the_answer() {
    let mut case = block(-30.0);
    case.push(Group::Unilateral, &[1.0, 0.0], &[4.0], 100.0, 0.0);
    case.push(Group::Friction, &[1.0, 0.0], &[0.0], 10.0, 3.0);
    let mut inequalities = Inequalities::new();
    let first = case.solve(&mut inequalities, "auto", None);
    assert!(first.report.changed, "the first solve");
    let again = case.solve(&mut inequalities, "auto", Some(&first.qacc));
    assert!(again.report.iterations <= 1 && again.report.warm && !again.report.changed);
    // Pieces as they were, other forces: one step, whatever the distance.
    case.force[0] = -300.0;
    let moved = case.solve(&mut inequalities, "auto", Some(&first.qacc));
    assert_eq!((moved.report.iterations, moved.report.changed), (1, false));
    case.force[0] = 300.0;
    assert!(case.solve(&mut inequalities, "auto", Some(&first.qacc)).report.changed);
}

#[test]
fn a_system_is_asked_again_from_another_start_as_if_assembled_anew() {
    let mut case = block(-30.0);
    case.equalities = vec![0.5, 1.0, 1.0, 2.0];
    case.wanted = vec![5.0, 10.0];
    let mut system = ConstrainedSystem::new();
    system.assemble(&case.smooth()).expect("good");
    let start = case.pushed(&[7.0, -3.0]);
    system.renew(&start, &case.wanted).expect("finite");
    case.force = vec![-23.0, -2.0];
    let mut anew = ConstrainedSystem::new();
    anew.assemble(&case.smooth()).expect("good");
    assert_eq!((system.rhs(), system.unconstrained()), (anew.rhs(), anew.unconstrained()), "to the last bit");
    assert!(matches!(system.renew(&[f64::NAN, 0.0], &[0.0; 2]), Err(Error::NonFinite { .. })));
    assert!(matches!(system.renew(&[0.0; 2], &[0.0; 3]), Err(Error::Shape { .. })));
    assert_eq!(system.rhs(), anew.rhs(), "the last one stays");
    assert!(matches!(ConstrainedSystem::new().renew(&[], &[]), Err(Error::Empty { .. })));
}

#[test]
fn at_rest_an_acceleration_is_measured_by_what_pushes_and_what_it_holds_up() {
    let confirmed = |force: f64, off: f64| {
        let mut case = block(force);
        (case.equalities, case.wanted, case.force[1]) = (vec![0.5, 1.0], vec![0.0], 0.0);
        let mut system = ConstrainedSystem::new();
        system.assemble(&case.smooth()).expect("good");
        // A floor takes all of the force, and nothing moves.
        system.renew(&[0.0, 0.0], &case.wanted).expect("finite");
        let mut info = Info::trivial(0.0);
        info.status = Status::Inaccurate;
        system.confirm(&[off, 0.0], &[0.0, 0.0], &mut info);
        info.status
    };
    // 15 m/s² without the floor, and the promise is 1e-6 of it.
    assert_eq!(confirmed(-30.0, 1e-6), Status::Converged);
    assert_eq!(confirmed(-30.0, 1e-3), Status::Inaccurate, "beyond the promise");
    assert_eq!(confirmed(0.0, 1e-6), Status::Inaccurate, "nothing is at work");
}

/// A bar on two parallel rods that stand open by `gap` rad, and a limit of stiffness D on what they leave.
fn open(gap: f64, stiffness: f64) -> Touching {
    let mut case = Touching {
        mass: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        force: vec![0.0, 3.0, -5.0],
        equalities: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, gap.cos(), 1.0, gap.sin()],
        wanted: vec![0.0, 0.0, 0.0],
        ..Touching::default()
    };
    case.push(Group::Unilateral, &[0.0, 0.5, 1.0], &[1.0], stiffness, 0.0);
    case
}

#[test]
fn what_open_loops_leave_is_what_the_held_rank_leaves() {
    for stiffness in [1e2, 1e6] {
        let (mut system, mut inequalities) = (ConstrainedSystem::new(), Inequalities::new());
        for gap in [0.0, 1e-9, 1e-6, 1e-4, 1e-5] {
            system.hold_rank(&[gap; 3]);
            let case = open(gap, stiffness);
            let whole = case.solve_in(&mut system, &mut inequalities, "auto", None);
            assert_eq!((whole.report.coordinates, whole.report.blocked), (1, 0), "open by {gap}");
            assert!(whole.certificate.holds(), "open by {gap}: {:?}", whole.certificate);
            // The third row is held to be redundant; what it turns by is of first order in the gap.
            let closed = (stiffness * 1.0 - 5.0) / (stiffness + 1.0);
            assert_within("third velocity", (whole.qacc[2] - closed).abs(), 20.0 * gap + FORCE);
        }
        // Nobody holds a rank: three rows that count, and a limit that they fight.
        let whole = open(1e-4, stiffness).solve_in(&mut system, &mut inequalities, "auto", None);
        assert_eq!((whole.report.coordinates, whole.report.blocked), (0, 1));
    }
}

#[test]
fn a_gear_does_not_hide_what_its_loop_leaves() {
    let mut case = Touching {
        mass: vec![1e-8, 0.0, 0.0, 0.0, 1e3, 0.0, 0.0, 0.0, 1e3],
        force: vec![0.0, 200.0, 400.0],
        equalities: vec![1.0, -1e5, 0.0, 0.0, 1.0, -1.0, 0.0, 0.6, -0.6],
        wanted: vec![0.0; 3],
        ..Touching::default()
    };
    case.push(Group::Unilateral, &[0.0, 1.0, 0.0], &[1.0], 1e4, 0.0);
    let (mut system, mut inequalities) = (ConstrainedSystem::new(), Inequalities::new());
    system.set_constraints([0, 1, 1].into_iter());
    let whole = case.solve_in(&mut system, &mut inequalities, "auto", None);
    assert_eq!((whole.report.coordinates, whole.report.blocked), (1, 0), "{:?}", whole.report);
    // 2 000 kg and the rotor behind the gear, 100 kg, which a light mass feels in its tenth digit.
    let right = (600.0 + 1e4) / (2e3 + 1e-8 * 1e10 + 1e4);
    assert_within("the masses", (whole.qacc[1] - right).abs(), 1e-9);
    assert!(whole.certificate.holds(), "{:?}", whole.certificate);
}
