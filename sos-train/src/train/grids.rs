//! The occupancy grids of both fields, and how they follow the fields.

use glam::Vec3;
use neus_render::occupancy::OccupancyGrid;
use rayon::prelude::*;
use scene_decomp::probability::ProbabilityMap;
use scene_decomp::{BACKGROUND_HALF_SIDE, FrozenSurface, LevelSet};

use super::batch::Partition;
use crate::config::Transparency;

/// A cell whose opacity (1 - exp) stays below this is nothing.
const VISIBLE: f32 = 0.01;
/// What a cell keeps of its value when it is asked again. A thin surface fills little of a cell, so
/// that many answers miss it.
const DECAY: f32 = 0.8;
/// The same for the object, whose distance tells as much anywhere in the cell.
const OBJECT_DECAY: f32 = 0.2;

/// By how much of m^P the space that FoCoR may fill reaches into that of BaCo.
const OVERLAP: f32 = 0.1;
/// Cells that one task asks about.
const CHUNK: usize = 1024;

/// Occupied space of both fields.
#[derive(Clone, Debug)]
pub struct FieldGrids {
    /// FoCoR's, over the box.
    pub object: OccupancyGrid,
    /// BaCo's, over contracted space.
    pub background: OccupancyGrid,
    /// Cells that FoCoR may ever fill: m^P is not too small there.
    allowed: Vec<u32>,
    /// What a cell holds that is newly allowed.
    fresh: f32,
    /// Where FoCoR may be.
    hull: LevelSet,
    /// Where BaCo may not be.
    crop: LevelSet,
}

/// What a field's grid depends on besides the field.
#[derive(Clone, Copy, Debug)]
pub struct GridRule {
    /// Whether the field is a distance or a density.
    pub transparency: Transparency,
    /// `b` of the field's logistic density.
    pub sharpness: f32,
    /// Whether the field changes so little by now that cells can be asked half as often.
    pub settled: bool,
}

impl FieldGrids {
    /// All allowed cells occupied. BaCo ends where m^P reaches `crop`; FoCoR is allowed in cells where it
    /// reaches a little less, looked up at corners and centre.
    #[must_use]
    pub fn new(resolution: u32, map: &ProbabilityMap, crop: f32) -> Self {
        let mut background = OccupancyGrid::new(resolution, BACKGROUND_HALF_SIDE).with_decay(DECAY);
        background.set_all(2.0 * VISIBLE);
        let mut grids = Self {
            object: OccupancyGrid::new(resolution, 1.0).with_decay(OBJECT_DECAY),
            background,
            allowed: Vec::new(),
            fresh: 1.0,
            hull: LevelSet::new(map, crop - OVERLAP),
            crop: LevelSet::new(map, crop),
        };
        grids.allow(map, crop);
        grids
    }

    /// For an object that is a density: its cells forget as slowly as the background's, and so begin
    /// with as little.
    #[must_use]
    pub fn with_object_density(mut self) -> Self {
        let resolution = self.object.resolution();
        self.object = OccupancyGrid::new(resolution, 1.0).with_decay(DECAY);
        self.fresh = 2.0 * VISIBLE;
        self.object
            .update(&self.allowed, &vec![self.fresh; self.allowed.len()]);
        self.object.rebuild_bits(VISIBLE);
        self
    }

    /// Which part of the box each field may fill by `map`, the one last allowed; all of it is BaCo's
    /// unless the object has been `carved` out.
    #[must_use]
    pub fn partition<'a>(&'a self, map: &'a ProbabilityMap, carved: bool) -> Partition<'a> {
        Partition {
            map,
            hull: &self.hull,
            crop: carved.then_some(&self.crop),
        }
    }

    /// Follows a new m^P: cells that are allowed from now on are occupied until they have been asked,
    /// others are empty.
    pub fn allow(&mut self, map: &ProbabilityMap, crop: f32) {
        self.hull = LevelSet::new(map, crop - OVERLAP);
        self.crop = LevelSet::new(map, crop);
        let grid = &mut self.object;
        let mut before = vec![false; grid.cell_count()];
        for &cell in &self.allowed {
            before[cell as usize] = true;
        }
        self.allowed = reached_cells(grid, &self.hull, map);
        let values: Vec<f32> = self
            .allowed
            .iter()
            .map(|cell| {
                if before[*cell as usize] {
                    grid.values()[*cell as usize]
                } else {
                    self.fresh
                }
            })
            .collect();
        grid.set_all(0.0);
        grid.update(&self.allowed, &values);
        grid.rebuild_bits(VISIBLE);
    }

    /// Share of the object's allowed cells that are occupied.
    #[must_use]
    pub fn object_share(&self) -> f32 {
        self.object.occupied_count() as f32 / self.allowed.len().max(1) as f32
    }

    /// Takes over the values of both grids from a checkpoint.
    ///
    /// # Errors
    /// When their number is not that of the cells.
    pub fn restore(&mut self, object: &[f32], background: &[f32]) -> Result<(), String> {
        for (grid, values) in [
            (&mut self.object, object),
            (&mut self.background, background),
        ] {
            if values.len() != grid.cell_count() {
                return Err(format!(
                    "its occupancy has {} cells, not {}",
                    values.len(),
                    grid.cell_count()
                ));
            }
            let cells: Vec<u32> = (0..values.len() as u32).collect();
            grid.set_all(0.0);
            grid.update(&cells, values);
            grid.rebuild_bits(VISIBLE);
        }
        Ok(())
    }

    /// Asks the object about a quarter of its allowed cells, or an eighth when the field has settled;
    /// `round` counts the updates.
    pub fn update_object(&mut self, field: &FrozenSurface, rule: GridRule, seed: u64, round: u32) {
        let every = if rule.settled { 8 } else { 4 };
        let cells: Vec<u32> = self
            .allowed
            .par_iter()
            .copied()
            .filter(|&cell| is_due(cell, round, every))
            .collect();
        let grid = &mut self.object;
        update(grid, &cells, field, rule, u64::from(round) ^ seed);
        grid.rebuild_bits(VISIBLE);
    }

    /// Asks the background about a quarter of the occupied cells, or an eighth when the field has
    /// settled, and a 64th of the others.
    pub fn update_background(
        &mut self,
        field: &FrozenSurface,
        rule: GridRule,
        seed: u64,
        round: u32,
    ) {
        let of_occupied = if rule.settled { 8 } else { 4 };
        let grid = &mut self.background;
        let cells: Vec<u32> = (0..grid.cell_count() as u32)
            .into_par_iter()
            .filter(|&cell| {
                let every = if grid.cell_occupied(cell) {
                    of_occupied
                } else {
                    64
                };
                is_due(cell, round, every)
            })
            .collect();
        update(grid, &cells, field, rule, u64::from(round) ^ seed);
        grid.rebuild_bits(VISIBLE);
    }
}

/// Cells of `grid` that `hull` reaches, in order: it contains the centre or a corner.
fn reached_cells(grid: &OccupancyGrid, hull: &LevelSet, map: &ProbabilityMap) -> Vec<u32> {
    let (n, cell) = (grid.resolution() as usize, grid.cell_size());
    let origin = grid.centre_of(0) - 0.5 * cell;
    // Cells share their corners, so these are asked once and not eight times.
    let side = n + 1;
    let mut corners = vec![false; side.pow(3)];
    corners
        .par_chunks_mut(side)
        .enumerate()
        .for_each(|(row, corners)| {
            let (y, z) = ((row % side) as f32, (row / side) as f32);
            for (x, corner) in corners.iter_mut().enumerate() {
                *corner = hull.contains(map, origin + cell * Vec3::new(x as f32, y, z));
            }
        });
    (0..grid.cell_count() as u32)
        .into_par_iter()
        .filter(|&number| {
            let i = number as usize;
            let first = ((i / (n * n)) * side + i / n % n) * side + i % n;
            let at = |x: usize, y: usize, z: usize| corners[first + (z * side + y) * side + x];
            (0..8).any(|c| at(c & 1, c >> 1 & 1, c >> 2))
                || hull.contains(map, grid.centre_of(number))
        })
        .collect()
}

/// Every cell is due once in `every` rounds, a power of two; neighbours in different ones.
fn is_due(cell: u32, round: u32, every: u32) -> bool {
    debug_assert!(every.is_power_of_two());
    // All of millions of cells are asked this, so without a division.
    (cell.wrapping_mul(0x9e37_79b9) >> 16).wrapping_add(round) & (every - 1) == 0
}

/// Renews cells with how opaque the field makes them.
fn update(
    grid: &mut OccupancyGrid,
    cells: &[u32],
    field: &FrozenSurface,
    rule: GridRule,
    seed: u64,
) {
    let mut points = vec![0.0; 3 * cells.len()];
    points
        .par_chunks_mut(3)
        .zip(cells)
        .with_min_len(CHUNK)
        .for_each(|(point, &cell)| grid.jittered(cell, seed).write_to_slice(point));
    let distances = field.distances_of(points);
    let cell = grid.cell_size();
    // A surface within the cell's diagonal, widened by the reach of the logistic density: beyond
    // 6 / b on either side of it, Phi_b changes by less than 0.3 %.
    let reach = 1.8 * cell + 6.0 / rule.sharpness.max(1e-3);
    let values: Vec<f32> = distances
        .into_par_iter()
        .with_min_len(CHUNK)
        .map(|value| match rule.transparency {
            Transparency::Sdf => f32::from(u8::from(value.abs() < reach)),
            Transparency::Density => {
                -(-scene_decomp::colour_field::density_of(value) * cell).exp_m1()
            }
        })
        .collect();
    grid.update(cells, &values);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_reached_at_their_centre_or_a_corner() {
        let n = 16;
        let values = (0..n * n * n)
            .map(|cell| {
                let p = ProbabilityMap::centre(n, cell);
                0.5 + 0.4 * (5.0 * p.x).sin() * (4.0 * p.y).cos() + 0.1 * p.z
            })
            .collect();
        let map = ProbabilityMap::new(n, values);
        let hull = LevelSet::new(&map, 0.6);
        let grid = OccupancyGrid::new(16, 1.0);
        let half = 0.5 * grid.cell_size();
        let expected: Vec<u32> = (0..grid.cell_count() as u32)
            .filter(|&cell| {
                let signs = [-half, half];
                let corner = |c: usize| Vec3::new(signs[c & 1], signs[c >> 1 & 1], signs[c >> 2]);
                let centre = grid.centre_of(cell);
                hull.contains(&map, centre)
                    || (0..8).any(|c| hull.contains(&map, centre + corner(c)))
            })
            .collect();
        assert_eq!(reached_cells(&grid, &hull, &map), expected);
        assert!(expected.len() > 500 && expected.len() < 3500);
    }
}
