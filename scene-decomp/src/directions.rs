//! View directions as spherical harmonics.
//!
//! A colour network that gets a bare direction learns highlights slowly, and explains them by
//! geometry of their own: a mirror image below a polished table. The harmonics' products of
//! coordinates give it the curvature it would have to make from ReLUs (Instant-NGP feeds its colour
//! network the same way).

/// The highest degree that is written out below.
pub(crate) const MOST_DEGREE: u32 = 4;

/// Real spherical harmonics of bands 2 to `degree - 1`, without the constant and the linear band,
/// which a network with a bias has in the direction itself. `directions` is `[n, 3]`, unit; the
/// result `[n, harmonics(degree)]`.
///
/// `degree` counts bands as Instant-NGP does: up to 2 they add nothing, 4 is the most, and higher ones are as 4.
#[must_use]
pub fn spherical_harmonics(directions: &[f32], degree: u32) -> Vec<f32> {
    let columns = harmonics(degree);
    let mut out = Vec::with_capacity(directions.len() / 3 * columns);
    if columns == 0 {
        return out;
    }
    for direction in directions.chunks_exact(3) {
        let [x, y, z] = [direction[0], direction[1], direction[2]];
        let (xx, yy, zz) = (x * x, y * y, z * z);
        out.extend([
            1.092_548_4 * x * y,
            1.092_548_4 * y * z,
            0.315_391_57 * (3.0 * zz - 1.0),
            1.092_548_4 * x * z,
            0.546_274_2 * (xx - yy),
        ]);
        if degree > 3 {
            out.extend([
                0.590_043_6 * y * (3.0 * xx - yy),
                2.890_611_4 * x * y * z,
                0.457_045_8 * y * (5.0 * zz - 1.0),
                0.373_176_33 * z * (5.0 * zz - 3.0),
                0.457_045_8 * x * (5.0 * zz - 1.0),
                1.445_305_7 * z * (xx - yy),
                0.590_043_6 * x * (xx - 3.0 * yy),
            ]);
        }
    }
    out
}

/// Columns of [`spherical_harmonics`].
#[must_use]
pub const fn harmonics(degree: u32) -> usize {
    match degree {
        0..=2 => 0,
        3 => 5,
        _ => 12,
    }
}

/// A colour network's further inputs: every row of `extra`, `[n, E]`, followed by the harmonics of
/// `directions`, `[n, 3]`.
#[must_use]
pub(crate) fn colour_extra(directions: &[f32], extra: &[f32], degree: u32) -> Vec<f32> {
    let width = extra.len() / (directions.len() / 3).max(1);
    let rows = spherical_harmonics(directions, degree);
    if rows.is_empty() {
        return extra.to_vec();
    }
    if width == 0 {
        return rows;
    }
    extra
        .chunks_exact(width)
        .zip(rows.chunks_exact(harmonics(degree)))
        .flat_map(|(extra, row)| extra.iter().chain(row).copied())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn harmonics_are_orthonormal() {
        // Points of a Fibonacci spiral cover the sphere evenly.
        let n = 20_000;
        let directions: Vec<f32> = (0..n)
            .flat_map(|i| {
                let z = 1.0 - (2.0 * i as f32 + 1.0) / n as f32;
                let (sin, cos) = (i as f32 * 2.399_963_2).sin_cos();
                let r = (1.0 - z * z).sqrt();
                [r * cos, r * sin, z]
            })
            .collect();
        let rows = spherical_harmonics(&directions, 4);
        assert_eq!(rows.len(), n * harmonics(4));
        let area = 4.0 * std::f32::consts::PI;
        for i in 0..12 {
            for j in 0..=i {
                let sum: f32 = rows.chunks_exact(12).map(|row| row[i] * row[j]).sum();
                let expected = f32::from(u8::from(i == j));
                let product = sum * area / n as f32;
                assert!((product - expected).abs() < 5e-3, "{i} {j}: {product}");
            }
        }
    }

    #[test]
    fn low_degrees_add_nothing_and_rows_stay_together() {
        assert!(spherical_harmonics(&[0.0, 0.0, 1.0], 2).is_empty());
        assert_eq!(spherical_harmonics(&[0.0, 0.0, 1.0], 3).len(), 5);
        let directions = [0.0, 0.0, 1.0, 0.0, 1.0, 0.0];
        assert_eq!(colour_extra(&directions, &[7.0, 8.0], 1), [7.0, 8.0]);
        let rows = spherical_harmonics(&directions, 3);
        assert_eq!(colour_extra(&directions, &[], 3), rows);
        let joined = colour_extra(&directions, &[7.0, 8.0], 3);
        assert_eq!(joined.len(), 12);
        assert_eq!((joined[0], &joined[1..6]), (7.0, &rows[..5]));
        assert_eq!((joined[6], &joined[7..]), (8.0, &rows[5..]));
    }
}
