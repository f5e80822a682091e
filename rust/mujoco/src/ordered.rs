//! Sums in an order that is written down: from left to right, without fused products. The Python path adds in the same order,
//! so that both come to the same bits.

/// Σ a b.
#[must_use]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut products = a.iter().zip(b).map(|(a, b)| a * b);
    let first = products.next().unwrap_or(0.0);
    products.fold(first, |sum, product| sum + product)
}

/// `product` (rows) = `matrix` (rows×columns, row-major) `vector` (columns).
pub fn times(matrix: &[f64], vector: &[f64], product: &mut [f64]) {
    for (row, entry) in matrix.chunks_exact(vector.len()).zip(product) {
        *entry = dot(row, vector);
    }
}

/// √Σ v².
#[must_use]
pub fn norm(vector: &[f64]) -> f64 {
    dot(vector, vector).sqrt()
}

/// ‖value − reference‖ / ‖reference‖; the absolute difference where the reference is zero.
#[must_use]
pub fn relative_difference(value: &[f64], reference: &[f64]) -> f64 {
    let mut squares =
        value.iter().zip(reference).map(|(value, reference)| (value - reference) * (value - reference));
    let first = squares.next().unwrap_or(0.0);
    let difference = squares.fold(first, |sum, square| sum + square).sqrt();
    let scale = norm(reference);
    if scale > 0.0 { difference / scale } else { difference }
}

/// Largest magnitude; 0 of nothing, NaN where there is one.
#[must_use]
pub fn largest(values: &[f64]) -> f64 {
    values
        .iter()
        .fold(0.0, |most, value| if value.is_nan() || value.abs() > most { value.abs() } else { most })
}
