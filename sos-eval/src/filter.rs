//! Separable filtering of a plane of f64 values, `[height, width]`.

/// What a filter sees beyond the border.
#[derive(Clone, Copy)]
pub(crate) enum Border {
    /// The nearest pixel.
    Replicate,
    /// Nothing.
    Zero,
}

/// Correlates the plane with `across` along rows and with `down` along columns. Taps are odd in
/// number, the middle one belongs to the pixel itself.
pub(crate) fn separable(
    plane: &[f64],
    (width, height): (usize, usize),
    across: &[f64],
    down: &[f64],
    border: Border,
) -> Vec<f64> {
    if plane.is_empty() {
        return Vec::new();
    }
    let radius = across.len() / 2;
    let mut rows = vec![0.0; plane.len()];
    let mut padded = vec![0.0; width + 2 * radius];
    for (source, target) in plane.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        padded[radius..radius + width].copy_from_slice(source);
        if let Border::Replicate = border {
            padded[..radius].fill(source[0]);
            padded[radius + width..].fill(source[width - 1]);
        }
        for (k, &tap) in across.iter().enumerate() {
            add_scaled(target, tap, &padded[k..k + width]);
        }
    }

    let radius = down.len() / 2;
    let mut out = vec![0.0; plane.len()];
    for (y, target) in out.chunks_exact_mut(width).enumerate() {
        for (k, &tap) in down.iter().enumerate() {
            let wanted = y as isize + k as isize - radius as isize;
            let row = wanted.clamp(0, height as isize - 1);
            if matches!(border, Border::Replicate) || row == wanted {
                let start = row as usize * width;
                add_scaled(target, tap, &rows[start..start + width]);
            }
        }
    }
    out
}

fn add_scaled(target: &mut [f64], scale: f64, source: &[f64]) {
    for (t, s) in target.iter_mut().zip(source) {
        *t += scale * s;
    }
}
