//! The occupancy grids of both fields, and how they follow the fields.

use glam::Vec3;
use neus_render::occupancy::OccupancyGrid;
use rand::RngExt;
use scene_decomp::probability::ProbabilityMap;
use scene_decomp::{BACKGROUND_HALF_SIDE, FrozenSurface};

use super::sampler::step_random;
use crate::config::Transparency;

/// Occupied space of both fields.
#[derive(Clone, Debug)]
pub struct FieldGrids {
    /// FoCoR's, over the box.
    pub object: OccupancyGrid,
    /// BaCo's, over contracted space.
    pub background: OccupancyGrid,
    /// Cells that FoCoR may ever fill: m^P is not too small there.
    allowed: Vec<u32>,
}

/// What a field's grid depends on besides the field.
#[derive(Clone, Copy, Debug)]
pub struct GridRule {
    /// Whether the field is a distance or a density.
    pub transparency: Transparency,
    /// `b` of the field's logistic density.
    pub sharpness: f32,
}

impl FieldGrids {
    /// All allowed cells occupied. FoCoR is allowed where m^P, looked up at a cell's corners and
    /// centre, reaches `hull_threshold`.
    #[must_use]
    pub fn new(resolution: u32, map: &ProbabilityMap, hull_threshold: f32) -> Self {
        let mut object = OccupancyGrid::new(resolution, 1.0).with_decay(0.6);
        let half = 0.5 * object.cell_size();
        let allowed: Vec<u32> = (0..object.cell_count() as u32)
            .filter(|&cell| {
                let centre = object.centre_of(cell);
                (0..9).any(|corner| {
                    let offset = match corner {
                        8 => Vec3::ZERO,
                        c => Vec3::new(
                            if c & 1 == 0 { -half } else { half },
                            if c & 2 == 0 { -half } else { half },
                            if c & 4 == 0 { -half } else { half },
                        ),
                    };
                    map.at(centre + offset) >= hull_threshold
                })
            })
            .collect();
        object.update(&allowed, &vec![1.0; allowed.len()]);
        object.rebuild_bits(0.5);
        let mut background = OccupancyGrid::new(resolution, BACKGROUND_HALF_SIDE).with_decay(0.6);
        background.set_all(1.0);
        background.rebuild_bits(0.5);
        Self {
            object,
            background,
            allowed,
        }
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
            grid.rebuild_bits(0.5);
        }
        Ok(())
    }

    /// Asks the object about a quarter of its allowed cells.
    pub fn update_object(&mut self, field: &FrozenSurface, rule: GridRule, seed: u64, step: u32) {
        let mut random = step_random(seed ^ 0x00b1_ec75, step);
        let cells: Vec<u32> = self
            .allowed
            .iter()
            .copied()
            .filter(|_| random.random::<f32>() < 0.25)
            .collect();
        let grid = &mut self.object;
        update(grid, &cells, field, rule, u64::from(step) ^ seed);
        grid.rebuild_bits(0.5);
    }

    /// Asks the background about a sixteenth of all cells and a quarter of the occupied ones.
    pub fn update_background(
        &mut self,
        field: &FrozenSurface,
        rule: GridRule,
        seed: u64,
        step: u32,
    ) {
        let mut random = step_random(seed ^ 0x00ba_c0ba, step);
        let grid = &mut self.background;
        let cells: Vec<u32> = (0..grid.cell_count() as u32)
            .filter(|&cell| {
                let share = if grid.cell_occupied(cell) {
                    0.25
                } else {
                    1.0 / 32.0
                };
                random.random::<f32>() < share
            })
            .collect();
        update(grid, &cells, field, rule, u64::from(step) ^ seed);
        grid.rebuild_bits(0.5);
    }
}

/// 1 for cells that may hold something visible, else 0.
fn update(
    grid: &mut OccupancyGrid,
    cells: &[u32],
    field: &FrozenSurface,
    rule: GridRule,
    seed: u64,
) {
    let points: Vec<f32> = cells
        .iter()
        .flat_map(|&cell| grid.jittered(cell, seed).to_array())
        .collect();
    let geometry = field.geometry(&points);
    let cell = grid.cell_size();
    // A surface within the cell's diagonal, widened by the reach of the logistic density: beyond
    // 6 / b on either side of it, Phi_b changes by less than 0.3 %.
    let reach = 1.8 * cell + 6.0 / rule.sharpness.max(1e-3);
    let values: Vec<f32> = (0..cells.len())
        .map(|i| {
            let value = geometry.sdf(i);
            let visible = match rule.transparency {
                Transparency::Sdf => value.abs() < reach,
                // Less than 1 % opacity across the cell is nothing.
                Transparency::Density => super::step::density_of(value) * cell > 0.01,
            };
            f32::from(u8::from(visible))
        })
        .collect();
    grid.update(cells, &values);
}
