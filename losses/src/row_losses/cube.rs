//! The op on the GPU. Terms are compiled in: which there are changes a few times in a training.

use burn::backend::{Cube, tensor::FloatTensor};
use gpu_tensors::{buffer, column_sums, contiguous, cubecl, fresh, units_for, workgroups, zeros};

use cubecl::prelude::*;

use super::autodiff::RowLossesBackwardOps;
use super::{RowLoss, RowLossesOps, RowTerm, check};
use crate::{ColourLoss, OPACITY_OFFSET};

/// Threads of a workgroup, which add up what they have in halves.
const UNITS: usize = 256;
const HALVES: usize = UNITS.ilog2() as usize;
/// Rows that a thread takes where there are enough of them, and the most workgroups.
const ROWS: usize = 4;
const GROUPS: usize = 64;
/// Terms that a workgroup adds up at once: each takes 1 KiB of the memory its threads share, of which every device has 16.
const TERMS: usize = 16;

/// What a term does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Kind {
    Square,
    Absolute,
    Huber,
    Mask,
    Shortfall,
    Value,
    UnitLength,
    Sparsity,
    Surface,
}

/// A term as a kernel's constant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Term {
    kind: Kind,
    /// The column that has the gradient, or the first of three.
    column: usize,
    /// The known column beside it, or for a shortfall another of the row.
    other: usize,
    weight: usize,
    /// Bits of Huber's delta, or of tau.
    constant: u32,
}

impl Term {
    fn of(term: &RowTerm) -> Self {
        let (kind, column, other, constant) = match term.loss {
            RowLoss::Colour {
                kind,
                colour,
                photo,
            } => match kind {
                ColourLoss::L2 => (Kind::Square, colour, photo, 0.0),
                ColourLoss::L1 => (Kind::Absolute, colour, photo, 0.0),
                ColourLoss::Huber { delta } => (Kind::Huber, colour, photo, delta),
            },
            RowLoss::Mask { opacity, mask } => (Kind::Mask, opacity, mask, 0.0),
            RowLoss::Shortfall { seen, most } => (Kind::Shortfall, seen, most, 0.0),
            RowLoss::Value { column } => (Kind::Value, column, 0, 0.0),
            RowLoss::UnitLength { length } => (Kind::UnitLength, length, 0, 0.0),
            RowLoss::Sparsity { sdf, tau } => (Kind::Sparsity, sdf, 0, tau),
            RowLoss::Surface { sdf } => (Kind::Surface, sdf, 0, 0.0),
        };
        Self {
            kind,
            column,
            other,
            weight: term.weight,
            constant: constant.to_bits(),
        }
    }

    /// Columns that have a gradient.
    fn width(self) -> usize {
        match self.kind {
            Kind::Square | Kind::Absolute | Kind::Huber => 3,
            Kind::Mask
            | Kind::Shortfall
            | Kind::Value
            | Kind::UnitLength
            | Kind::Sparsity
            | Kind::Surface => 1,
        }
    }

    fn has(self, column: usize) -> bool {
        (self.column..self.column + self.width()).contains(&column)
    }

    fn constant(self) -> f32 {
        f32::from_bits(self.constant)
    }
}

/// A kernel's constants.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Sizes {
    columns: usize,
    known: usize,
    terms: Vec<Term>,
    /// The terms' place among all of them, and how many those are.
    first: usize,
    of: usize,
}

impl Sizes {
    fn new(rows: &FloatTensor<Cube>, known: &FloatTensor<Cube>, terms: &[RowTerm]) -> Self {
        Self {
            columns: rows.meta.shape()[1],
            known: known.meta.shape()[1],
            terms: terms.iter().map(Term::of).collect(),
            first: 0,
            of: terms.len(),
        }
    }

    /// The same for at most [`TERMS`] terms each.
    fn parts(&self) -> impl Iterator<Item = Self> {
        let parts = self.terms.chunks(TERMS).enumerate();
        parts.map(|(part, terms)| Self {
            terms: terms.to_vec(),
            first: part * TERMS,
            ..self.clone()
        })
    }
}

impl RowLossesOps for Cube {
    fn row_losses(
        rows: FloatTensor<Self>,
        known: FloatTensor<Self>,
        terms: Vec<RowTerm>,
    ) -> FloatTensor<Self> {
        check(rows.meta.shape(), known.meta.shape(), &terms);
        let n = rows.meta.shape()[0];
        if n == 0 {
            return zeros(&rows, [terms.len()]);
        }
        let sizes = Sizes::new(&rows, &known, &terms);
        let groups = n.div_ceil(ROWS * UNITS).min(GROUPS);
        let one = groups == 1;
        let sums = if one {
            fresh(&rows, [terms.len()])
        } else {
            fresh(&rows, [groups, terms.len()])
        };
        let (rows, known) = (contiguous(rows), contiguous(known));
        for part in sizes.parts() {
            let (count, dim) = workgroups(&rows.client, groups, UNITS);
            // SAFETY: rows end with the matrices, whose columns `check` has seen; workgroups beyond `groups` write nothing.
            unsafe {
                sums_kernel::launch_unchecked(
                    &sums.client,
                    count,
                    dim,
                    buffer(&rows),
                    buffer(&known),
                    buffer(&sums),
                    n as u32,
                    groups as u32,
                    part,
                );
            }
        }
        if one {
            sums
        } else {
            column_sums(&sums, 0, terms.len())
        }
    }
}

impl RowLossesBackwardOps for Cube {
    fn row_losses_backward(
        rows: FloatTensor<Self>,
        known: FloatTensor<Self>,
        terms: &[RowTerm],
        grad: FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        check(rows.meta.shape(), known.meta.shape(), terms);
        assert_eq!(
            grad.meta.shape()[..],
            [terms.len()],
            "row_losses: the sums' gradient"
        );
        let n = rows.meta.shape()[0];
        let sizes = Sizes::new(&rows, &known, terms);
        let out = fresh(&rows, [n, sizes.columns]);
        if n > 0 {
            let (count, dim) = units_for(&out.client, n);
            // SAFETY: threads beyond the rows return at once; `check` has seen the columns.
            unsafe {
                gradient_kernel::launch_unchecked(
                    &out.client,
                    count,
                    dim,
                    buffer(&contiguous(rows)),
                    buffer(&contiguous(known)),
                    buffer(&contiguous(grad)),
                    buffer(&out),
                    n as u32,
                    sizes,
                );
            }
        }
        out
    }
}

/// A workgroup's share of the sums. Everything is added in an order that depends on the number of rows alone.
#[cube(launch_unchecked)]
fn sums_kernel(
    rows: &[f32],
    known: &[f32],
    sums: &mut [f32],
    n: u32,
    groups: u32,
    #[comptime] sizes: Sizes,
) {
    let (n, groups) = (n as usize, groups as usize);
    let unit = UNIT_POS as usize;
    let terms = comptime!(sizes.terms.len());
    let mut shares = Shared::<[f32]>::new_slice(comptime!(UNITS * terms));
    #[unroll]
    for t in 0..terms {
        let term = comptime!(sizes.terms[t]);
        let mut sum = 0.0f32;
        let mut row = select(CUBE_POS < groups, CUBE_POS * UNITS + unit, n);
        while row < n {
            let (from, beside) = (row * comptime!(sizes.columns), row * comptime!(sizes.known));
            let weight = known[beside + comptime!(term.weight)];
            let value = value(rows, known, from, beside, term);
            // Zero times what is no number would be none.
            sum += select(weight == 0.0f32, 0.0f32, weight * value);
            row += groups * UNITS;
        }
        shares[unit + comptime!(t * UNITS)] = sum;
    }
    sync_cube();
    #[unroll]
    for h in 0..HALVES {
        let half = comptime!(UNITS >> (h + 1));
        if unit < half {
            #[unroll]
            for t in 0..terms {
                let other = shares[unit + comptime!(t * UNITS) + half];
                shares[unit + comptime!(t * UNITS)] += other;
            }
        }
        sync_cube();
    }
    if unit < terms && CUBE_POS < groups {
        let at = CUBE_POS * comptime!(sizes.of) + comptime!(sizes.first);
        sums[at + unit] = shares[unit * UNITS];
    }
}

/// One thread for each row.
#[cube(launch_unchecked)]
fn gradient_kernel(
    rows: &[f32],
    known: &[f32],
    grad: &[f32],
    out: &mut [f32],
    n: u32,
    #[comptime] sizes: Sizes,
) {
    let row = ABSOLUTE_POS;
    if row < n as usize {
        let (from, beside) = (row * comptime!(sizes.columns), row * comptime!(sizes.known));
        #[unroll]
        for column in 0..comptime!(sizes.columns) {
            let mut sum = 0.0f32;
            #[unroll]
            for t in 0..comptime!(sizes.terms.len()) {
                let term = comptime!(sizes.terms[t]);
                if comptime!(term.has(column)) {
                    let slope = slope(rows, known, from, beside, column, term);
                    let weight = known[beside + comptime!(term.weight)];
                    sum += select(weight == 0.0f32, 0.0f32, grad[t] * weight * slope);
                }
            }
            out[from + column] = sum;
        }
    }
}

/// The loss of the row that begins at `from`, and at `beside` in what is known.
#[cube]
fn value(rows: &[f32], known: &[f32], from: usize, beside: usize, #[comptime] term: Term) -> f32 {
    let x = rows[from + comptime!(term.column)];
    let mut value = 0.0f32;
    if comptime!(term.width() == 3) {
        #[unroll]
        for k in 0..3usize {
            let c = rows[from + comptime!(term.column + k)];
            let residual = c - known[beside + comptime!(term.other + k)];
            if comptime!(term.kind == Kind::Absolute) {
                value += residual.abs();
            } else if comptime!(term.kind == Kind::Huber) {
                let delta = comptime!(term.constant());
                let size = residual.abs();
                let far = delta * (2.0f32 * size - delta);
                value += select(size > delta, far, residual * residual);
            } else {
                value += residual * residual;
            }
        }
        value /= 3.0f32;
    } else if comptime!(term.kind == Kind::Mask) {
        let m = known[beside + comptime!(term.other)];
        let empty = (comptime!(1.0f32 + OPACITY_OFFSET) - x).ln();
        let filled = (x + OPACITY_OFFSET).ln();
        value = -((1.0f32 - m) * empty + m * filled);
    } else if comptime!(term.kind == Kind::Shortfall) {
        let short = rows[from + comptime!(term.other)] - x;
        value = select(short < 0.0f32, 0.0f32, short);
    } else if comptime!(term.kind == Kind::Value) {
        value = x;
    } else if comptime!(term.kind == Kind::Surface) {
        value = x.abs();
    } else if comptime!(term.kind == Kind::Sparsity) {
        value = (comptime!(-term.constant()) * x.abs()).exp();
    } else {
        value = (x - 1.0f32) * (x - 1.0f32);
    }
    value
}

/// The derivative of [`value`] by a column that has one.
#[cube]
fn slope(
    rows: &[f32],
    known: &[f32],
    from: usize,
    beside: usize,
    #[comptime] column: usize,
    #[comptime] term: Term,
) -> f32 {
    let x = rows[from + column];
    let mut slope = 1.0f32;
    if comptime!(term.width() == 3) {
        let residual = x - known[beside + comptime!(term.other + column - term.column)];
        let sign = sign(residual);
        if comptime!(term.kind == Kind::Absolute) {
            slope = sign;
        } else if comptime!(term.kind == Kind::Huber) {
            let delta = comptime!(term.constant());
            let far = 2.0f32 * delta * sign;
            slope = select(residual.abs() > delta, far, 2.0f32 * residual);
        } else {
            slope = 2.0f32 * residual;
        }
        slope /= 3.0f32;
    } else if comptime!(term.kind == Kind::Mask) {
        let m = known[beside + comptime!(term.other)];
        slope = (1.0f32 - m) / (comptime!(1.0f32 + OPACITY_OFFSET) - x) - m / (x + OPACITY_OFFSET);
    } else if comptime!(term.kind == Kind::Shortfall) {
        let most = rows[from + comptime!(term.other)];
        slope = select(most < x, 0.0f32, -1.0f32);
    } else if comptime!(term.kind == Kind::UnitLength) {
        slope = 2.0f32 * (x - 1.0f32);
    } else if comptime!(term.kind == Kind::Surface) {
        slope = sign(x);
    } else if comptime!(term.kind == Kind::Sparsity) {
        let fall = comptime!(-term.constant());
        slope = fall * sign(x) * (fall * x.abs()).exp();
    }
    slope
}

/// 1 or -1; 0 and NaN stay what they are.
#[cube]
fn sign(x: f32) -> f32 {
    let up = select(x > 0.0f32, 1.0f32, x);
    select(x < 0.0f32, -1.0f32, up)
}
