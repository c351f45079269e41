//! Encoding a tile of points, level after level.

use pulp::{Arch, Simd, WithSimd};

use super::cells::{Cells, LANES};
use super::level::{Level, first_block};
use crate::config::Interpolation;
use crate::layout::{FEATURES, GridLayout, LevelLayout};

/// Encodes one tile of `p` points, which are given as three arrays; `p` is a multiple of 16.
///
/// - `active`: number of levels in use; features of levels from `active` on are 0, and so are
///   their derivatives.
/// - `table`: `[entries, 2]`, row-major.
/// - `x`, `y`, `z`: positions in `[0, 1]`, each `[p]`. Outside, a coordinate is clamped, and the
///   derivative along it is 0. NaN counts as 0.
/// - `values`: `[2 L, p]`; feature `f` of level `l` is row `2 l + f`.
/// - `jacobian`: `[2 L, 3, p]`; row `3 k + a` is the derivative of feature `k` along axis `a`.
///
/// The kernel picks the machine's widest vector instructions itself, once per call, which costs
/// nothing next to a tile; it may be called from code that is itself dispatched. A tile of a few
/// hundred points is best: each level's part of the table stays in cache for the whole tile.
///
/// # Panics
/// When a slice's length does not fit.
#[allow(clippy::too_many_arguments)]
pub fn encode_tile(
    layout: &GridLayout,
    active: usize,
    table: &[f32],
    x: &[f32],
    y: &[f32],
    z: &[f32],
    values: &mut [f32],
    jacobian: Option<&mut [f32]>,
) {
    let points = x.len();
    assert!(
        points.is_multiple_of(LANES),
        "encode_tile: {points} points, not a multiple of 16"
    );
    assert_eq!(y.len(), points, "encode_tile: length of y");
    assert_eq!(z.len(), points, "encode_tile: length of z");
    assert_eq!(
        table.len(),
        layout.entries() * FEATURES,
        "encode_tile: length of the table"
    );
    assert_eq!(
        values.len(),
        layout.features() * points,
        "encode_tile: length of values"
    );
    if let Some(jacobian) = &jacobian {
        assert_eq!(
            jacobian.len(),
            layout.features() * 3 * points,
            "encode_tile: length of jacobian"
        );
    }
    Arch::new().dispatch(EncodeTile {
        layout,
        active,
        table,
        position: [x, y, z],
        values,
        jacobian,
    });
}

/// [`encode_tile`]'s arguments, as pulp wants a function with generic body to be written.
pub(super) struct EncodeTile<'a> {
    pub(super) layout: &'a GridLayout,
    pub(super) active: usize,
    pub(super) table: &'a [f32],
    pub(super) position: [&'a [f32]; 3],
    pub(super) values: &'a mut [f32],
    pub(super) jacobian: Option<&'a mut [f32]>,
}

impl WithSimd for EncodeTile<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let points = self.position[0].len();
        if points == 0 {
            return;
        }
        let mut jacobian = self.jacobian;
        let rows = FEATURES * points;
        let smooth = self.layout.interpolation == Interpolation::Smoothstep;
        let active = self.active.min(self.layout.levels.len());
        let table_of = |level: &LevelLayout| {
            &self.table[FEATURES * level.offset..FEATURES * (level.offset + level.entries)]
        };
        let mut block = Cells::EMPTY;
        for (l, (level, values)) in self
            .layout
            .levels
            .iter()
            .zip(self.values.chunks_exact_mut(rows))
            .enumerate()
        {
            let jacobian = jacobian
                .as_deref_mut()
                .map(|j| &mut j[3 * rows * l..3 * rows * (l + 1)]);
            if l >= active {
                values.fill(0.0);
                if let Some(jacobian) = jacobian {
                    jacobian.fill(0.0);
                }
                continue;
            }
            if l == 0 {
                block = first_block(level, table_of(level), smooth, self.position);
            }
            let next = self.layout.levels[..active]
                .get(l + 1)
                .map(|next| (next, table_of(next)));
            let one = Level {
                level,
                table: table_of(level),
                position: self.position,
                block,
                next,
            };
            block = one.encode(smooth, values, jacobian);
        }
    }
}
