//! The minimum along a line of a convex function with a continuous, piecewise smooth slope.

/// The slope may have fallen to this part of the first one, on this side of the minimum.
const FALLEN: f64 = 0.1;

/// The same beyond the minimum, where only rounding is welcome: the function could have risen.
const RISEN: f64 = 1e-3;

/// The bracket is cut in the middle where Newton's steps have not halved it in so many.
const PATIENCE: usize = 4;

/// Evaluations at most: the bracket is down to 1e-7 of its length then, whatever the function.
const EVALUATIONS: usize = 100;

/// Whether a slope is small enough beside the first one, which is negative.
pub(super) fn is_flat(slope: f64, first: f64) -> bool {
    slope >= FALLEN * first && slope <= -RISEN * first
}

/// Finds where the slope vanishes, by Newton's method within a bracket. `at` gives slope and curvature; the first slope is negative, that
/// at 1 is known, and the curvature is `least` everywhere at least. Gives the place and the number of evaluations.
pub(super) fn search(
    first: f64,
    (slope, bend): (f64, f64),
    least: f64,
    mut at: impl FnMut(f64) -> (f64, f64),
) -> (f64, usize) {
    let (mut low, mut high) = (0.0, -first / least);
    let (mut alpha, mut slope, mut bend) = (1.0_f64, slope, bend);
    let mut width = high;
    for count in 0..EVALUATIONS {
        if is_flat(slope, first) {
            return (alpha, count);
        }
        if slope < 0.0 {
            low = alpha;
        } else {
            high = alpha;
        }
        let newton = alpha - slope / bend;
        let due = count % PATIENCE == PATIENCE - 1;
        let slow = due && high - low > 0.5 * width;
        if due || count == 0 {
            width = high - low;
        }
        alpha = if newton > low && newton < high && !slow { newton } else { 0.5 * (low + high) };
        if alpha <= low || alpha >= high {
            // Before the minimum the function has fallen for certain.
            return (low, count);
        }
        (slope, bend) = at(alpha);
    }
    (low, EVALUATIONS)
}
