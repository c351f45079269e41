//! Normals of fused distances.

use glam::Vec3;

/// Where the fused distances `solid` `[n^3]` grow at a voxel: a unit vector outwards, or nothing where they are even. At the
/// region's border no slope across it is known.
pub(super) fn normal(solid: &[f32], cell: usize, n: usize) -> Vec3 {
    let slope = |step: usize| {
        let along = cell / step % n;
        if along == 0 || along + 1 == n {
            return 0.0;
        }
        solid[cell + step] - solid[cell - step]
    };
    Vec3::new(slope(1), slope(n), slope(n * n)).normalize_or_zero()
}
