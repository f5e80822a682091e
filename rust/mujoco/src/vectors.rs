//! Small vector algebra in which every rounding is written down: sums from left to right, no product fused with a sum. The
//! Python path (`oarlock.vectors`) does the same, so that both give the same bits.

/// Three numbers.
pub type Vector = [f64; 3];

/// Σ of products, from left to right.
pub fn sum(products: impl Iterator<Item = f64>) -> f64 {
    // −0 + x is x, for −0 too.
    products.fold(-0.0, |sum, product| sum + product)
}

/// `product` (rows) = `matrix` (rows×columns, row-major) `vector` (columns).
pub fn times(matrix: &[f64], vector: &[f64], product: &mut [f64]) {
    for (row, entry) in matrix.chunks_exact(vector.len()).zip(product) {
        *entry = sum(row.iter().zip(vector).map(|(a, b)| a * b));
    }
}

/// √Σ v².
#[must_use]
pub fn norm(vector: &[f64]) -> f64 {
    sum(vector.iter().map(|entry| entry * entry)).abs().sqrt()
}

/// ‖value − reference‖ / ‖reference‖; the absolute difference where the reference is zero.
#[must_use]
pub fn relative_difference(value: &[f64], reference: &[f64]) -> f64 {
    let squares =
        value.iter().zip(reference).map(|(value, reference)| (value - reference) * (value - reference));
    let (difference, scale) = (sum(squares).abs().sqrt(), norm(reference));
    if scale > 0.0 { difference / scale } else { difference }
}

/// Largest magnitude; 0 of nothing, NaN where there is one.
#[must_use]
pub fn largest(values: &[f64]) -> f64 {
    values
        .iter()
        .fold(0.0, |most, value| if value.is_nan() || value.abs() > most { value.abs() } else { most })
}

/// The `index`th vector of an array of them.
#[must_use]
pub fn at(array: &[f64], index: usize) -> Vector {
    [array[3 * index], array[3 * index + 1], array[3 * index + 2]]
}

/// a + b.
#[must_use]
pub fn plus(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// a − b.
#[must_use]
pub fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The multiple of a vector.
#[must_use]
pub fn scaled(factor: f64, a: Vector) -> Vector {
    [factor * a[0], factor * a[1], factor * a[2]]
}

/// a · b.
#[must_use]
pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a × b.
#[must_use]
pub fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// c₀ + c₁ x + c₂ x² + …
///
/// # Panics
/// If there are no coefficients.
#[must_use]
pub fn horner(coefficients: &[f64], x: f64) -> f64 {
    let (&last, rest) = coefficients.split_last().expect("a polynomial has a coefficient");
    rest.iter().rev().fold(last, |value, &coefficient| coefficient + value * x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[allow(clippy::float_cmp)]
    fn order_is_from_left_to_right() {
        assert_eq!(sum([1e16, 1.0, 1.0].into_iter()), 1e16);
        assert_eq!(sum([1.0, 1.0, 1e16].into_iter()), 1e16 + 2.0);
        assert!(sum([-0.0, -0.0].into_iter()).is_sign_negative());
        assert_eq!(dot([1e16, 1.0, 1.0], [1.0, 1.0, 1.0]), 1e16);
    }

    #[test]
    #[allow(clippy::float_cmp)]
    fn algebra() {
        assert_eq!(cross([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), [0.0, 0.0, 1.0]);
        assert_eq!(horner(&[1.0, 2.0, 3.0], 2.0), 17.0);
        assert_eq!(
            minus(plus([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]), scaled(2.0, [1.0, 1.0, 1.0])),
            [3.0, 5.0, 7.0]
        );
        assert_eq!(at(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 1), [4.0, 5.0, 6.0]);
        assert_eq!(norm(&[2.0, 3.0, 6.0]), 7.0);
        let mut product = [0.0; 2];
        times(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[1.0, 0.0, -1.0], &mut product);
        assert_eq!(product, [-2.0, -2.0]);
    }

    #[test]
    #[allow(clippy::float_cmp)]
    fn differences_are_relative_to_what_is_there() {
        assert_eq!(relative_difference(&[3.0, 4.5], &[3.0, 4.0]), 0.1);
        assert_eq!(relative_difference(&[3.0, 4.0], &[0.0, 0.0]), 5.0);
        assert!(relative_difference(&[f64::NAN], &[1.0]).is_nan());
    }

    #[test]
    #[allow(clippy::float_cmp)]
    fn the_largest_magnitude_of_a_list_with_a_nan_is_that_nan() {
        assert_eq!(largest(&[]), 0.0);
        assert_eq!(largest(&[1.0, -3.0, 2.0]), 3.0);
        for place in 0..3 {
            let mut values = [1.0, -3.0, 2.0];
            values[place] = f64::NAN;
            assert!(largest(&values[..=place]).is_nan(), "at the end");
        }
    }
}
