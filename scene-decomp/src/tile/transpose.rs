//! Between point-major rows, as tensors hold them, and the feature-major tile.

use super::POINTS;

/// Fills `tile: [width, points]` from `rows: [count, width]`; points past `count` repeat the last.
///
/// Repeating keeps every lane's arithmetic ordinary; their results are never read.
#[inline(always)]
pub(crate) fn rows_to_tile(rows: &[f32], width: usize, tile: &mut [f32]) {
    let (count, points) = (rows.len() / width, tile.len() / width);
    if count == 0 {
        tile.fill(0.0);
        return;
    }
    for k in 0..width {
        let lane = &mut tile[k * points..(k + 1) * points];
        for (p, value) in lane[..count].iter_mut().enumerate() {
            *value = rows[p * width + k];
        }
        let last = lane[count - 1];
        lane[count..].fill(last);
    }
}

/// Like [`rows_to_tile`], with zeros past `count`: for gradients, which sum over the tile.
#[inline(always)]
pub(crate) fn rows_to_tile_padded(rows: &[f32], width: usize, tile: &mut [f32]) {
    let count = rows.len() / width;
    for k in 0..width {
        let lane = &mut tile[k * POINTS..(k + 1) * POINTS];
        for (p, value) in lane[..count].iter_mut().enumerate() {
            *value = rows[p * width + k];
        }
        lane[count..].fill(0.0);
    }
}

/// Writes `tile: [width, points]` back to `rows: [count, width]`.
#[inline(always)]
pub(crate) fn tile_to_rows(tile: &[f32], width: usize, rows: &mut [f32]) {
    let points = tile.len() / width;
    for (p, row) in rows.chunks_exact_mut(width).enumerate() {
        for (k, value) in row.iter_mut().enumerate() {
            *value = tile[k * points + p];
        }
    }
}
