//! The surface of a signed distance field as a mesh, block by block.
//!
//! The box is cut to cells, cubes as far as whole ones fit into it, and these to blocks of 16^3. A
//! first pass evaluates the field at block centres and drops blocks that the surface can't reach; the
//! others are marched cell by cell (marching cubes, with cases as in `cases.rs`). Vertices on the
//! edges of cells are shared by everything around them, blocks included, so the mesh is closed
//! wherever the surface is. Where the surface runs on into a block that the first pass dropped, that
//! block is marched as well.

mod block;
mod cases;
mod mesh;

use std::collections::{HashMap, HashSet, VecDeque};

use glam::{IVec3, Vec3};
use serde::{Deserialize, Serialize};

pub use mesh::{Measure, Mesh};

use crate::{field::SdfBatch, intersect::Aabb};
use block::{BLOCK, Block, NODES, Signs};

/// Blocks whose nodes are evaluated at once: about 80 thousand points.
const BLOCKS_AT_ONCE: usize = 16;
/// Points of other evaluations at once.
const POINTS_AT_ONCE: usize = 65536;

/// What becomes of a surface that leaves the box.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Border {
    /// It ends there with an open edge.
    Open,
    /// The solid is cut off by the box, and the mesh is closed. The box must be two cells thick at least.
    Closed,
}

/// How finely and how cautiously the surface is searched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct IsosurfaceConfig {
    /// Cells along the box's longest edge; along the others as many as keep a cell's edges about as long or shorter.
    /// Walls thinner than a cell may be missed.
    pub resolution: u32,
    /// How much the field may exceed true distances. A block is dropped when the field at its
    /// centre, divided by this, is more than half the block's diagonal.
    pub overestimate: f32,
    /// What becomes of a surface that leaves the box.
    pub border: Border,
}

impl Default for IsosurfaceConfig {
    fn default() -> Self {
        Self {
            resolution: 256,
            overestimate: 2.0,
            border: Border::Closed,
        }
    }
}

/// Why there is no mesh.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IsosurfaceError {
    /// The field has the same sign at all nodes that were looked at.
    #[error("the box contains no surface: the signed distance is {side} everywhere")]
    NoSurface {
        /// The sign found: "positive" (all empty) or "negative" (all solid).
        side: &'static str,
    },
    /// The field gave a value that is not finite.
    #[error("the signed distance is not finite at ({x}, {y}, {z})")]
    NotFinite {
        /// Where, as text, since floats have no equality.
        x: String,
        /// As `x`.
        y: String,
        /// As `x`.
        z: String,
    },
    /// A border that closes leaves nothing of a box that is one cell thick.
    #[error(
        "at resolution {resolution} the box is a single cell thick, all of which a closed border cuts off: choose a higher \
         resolution or an open border"
    )]
    TooThin {
        /// The resolution asked for.
        resolution: u32,
    },
    /// Resolution or box don't describe a grid.
    #[error("no grid: resolution {resolution} must be 1 to 4096, and the box must have a volume")]
    NoGrid {
        /// The resolution asked for.
        resolution: u32,
    },
}

/// The surface where `field` is zero, within `aabb`. The field is asked nowhere else.
///
/// ```
/// use glam::Vec3;
/// use neus_render::{
///     field::FnSdf,
///     intersect::Aabb,
///     isosurface::{IsosurfaceConfig, extract_isosurface},
/// };
///
/// let sphere = FnSdf(|p: Vec3| p.length() - 0.5);
/// let config = IsosurfaceConfig { resolution: 64, ..IsosurfaceConfig::default() };
/// let mesh = extract_isosurface(&sphere, &Aabb::UNIT, &config)?;
/// assert!((mesh.area() - std::f64::consts::PI).abs() < 0.01);
/// # Ok::<(), neus_render::isosurface::IsosurfaceError>(())
/// ```
///
/// # Errors
/// [`IsosurfaceError`]: no sign change, a value that is not finite, an impossible grid, or one too thin for its border.
pub fn extract_isosurface(
    field: &impl SdfBatch,
    aabb: &Aabb,
    config: &IsosurfaceConfig,
) -> Result<Mesh, IsosurfaceError> {
    let lattice = Lattice::new(aabb, config)?;
    let centres = lattice.evaluate_centres(field)?;
    let mut search = Search {
        lattice: &lattice,
        waiting: lattice.candidates(&centres, config.overestimate),
        queued: HashSet::new(),
        signs: HashMap::new(),
        shared: HashMap::new(),
        mesh: Mesh::default(),
    };
    search.queued.extend(search.waiting.iter().copied());
    search.run(field)?;
    let mut mesh = search.mesh;
    if mesh.triangles.is_empty() {
        let side = if centres.first().is_some_and(|&v| v < 0.0) {
            "negative"
        } else {
            "positive"
        };
        return Err(IsosurfaceError::NoSurface { side });
    }
    mesh.normals = normals(field, &mesh.positions, &lattice);
    Ok(mesh)
}

/// The cells of a box.
struct Lattice {
    aabb: Aabb,
    /// The edges of a cell; the last ones end where the box does.
    cell: Vec3,
    /// Cells along each axis.
    cells: IVec3,
    /// Blocks along each axis.
    blocks: IVec3,
    border: Border,
}

impl Lattice {
    fn new(aabb: &Aabb, config: &IsosurfaceConfig) -> Result<Self, IsosurfaceError> {
        let resolution = config.resolution;
        let size = aabb.size();
        let sound =
            (1..=4096).contains(&resolution) && size.cmpgt(Vec3::ZERO).all() && size.is_finite();
        if !sound {
            return Err(IsosurfaceError::NoGrid { resolution });
        }
        let cell = size.max_element() / resolution as f32;
        // A little less, so that rounding doesn't add a layer.
        let cells = (size / cell - 1e-3).ceil().as_ivec3().max(IVec3::ONE);
        // All nodes lie on the border then.
        if config.border == Border::Closed && cells.min_element() == 1 {
            return Err(IsosurfaceError::TooThin { resolution });
        }
        Ok(Self {
            aabb: *aabb,
            cell: size / cells.as_vec3(),
            cells,
            blocks: (cells + (BLOCK as i32 - 1)) / BLOCK as i32,
            border: config.border,
        })
    }

    /// Where a node is, or a place between nodes.
    fn position(&self, node: Vec3) -> Vec3 {
        // Rounding may put the last one beside the box.
        (self.aabb.min + node * self.cell).min(self.aabb.max)
    }

    /// Where the field is asked for a node. Blocks may reach out of the box, where it need not be defined; nothing is
    /// made of those nodes, and the nearest in the box stands for them.
    fn place_to_ask(&self, node: Vec3) -> Vec3 {
        self.position(node.min(self.cells.as_vec3()))
    }

    fn block_number(&self, block: IVec3) -> usize {
        let IVec3 { x, y, z } = block;
        (x + self.blocks.x * (y + self.blocks.y * z)) as usize
    }

    fn has_block(&self, block: IVec3) -> bool {
        block.cmpge(IVec3::ZERO).all() && block.cmplt(self.blocks).all()
    }

    fn all_blocks(&self) -> impl Iterator<Item = IVec3> + use<> {
        let blocks = self.blocks;
        (0..blocks.z).flat_map(move |z| {
            (0..blocks.y).flat_map(move |y| (0..blocks.x).map(move |x| IVec3::new(x, y, z)))
        })
    }

    fn evaluate_centres(&self, field: &impl SdfBatch) -> Result<Vec<f32>, IsosurfaceError> {
        let points: Vec<Vec3> = self
            .all_blocks()
            .map(|block| self.place_to_ask((block.as_vec3() + 0.5) * BLOCK as f32))
            .collect();
        evaluate(field, &points)
    }

    /// Blocks that may hold the surface, from the field at block centres.
    fn candidates(&self, centres: &[f32], overestimate: f32) -> VecDeque<IVec3> {
        // Enough for a centre that was moved into the box, too: no point of the box is farther from it than before.
        let cell = self.cell.max_element();
        let reach = 0.5 * 3.0f32.sqrt() * BLOCK as f32 * cell * overestimate.max(1.0);
        let negative = |block: IVec3| centres[self.block_number(block)] < 0.0;
        let may_hold = |block: &IVec3| {
            let near = centres[self.block_number(*block)].abs() <= reach;
            // Neighbours on both sides of the surface: it lies in one of them, whatever the field
            // claims about distances.
            near || face_neighbours(*block)
                .any(|other| self.has_block(other) && negative(other) != negative(*block))
                // A solid that the border cuts off has its surface there.
                || (self.border == Border::Closed
                    && negative(*block)
                    && face_neighbours(*block).any(|other| !self.has_block(other)))
        };
        self.all_blocks().filter(may_hold).collect()
    }
}

fn face_neighbours(block: IVec3) -> impl Iterator<Item = IVec3> {
    [IVec3::X, IVec3::Y, IVec3::Z]
        .into_iter()
        .flat_map(move |axis| [block - axis, block + axis])
}

/// The blocks still to be marched, and what has been found.
struct Search<'a> {
    lattice: &'a Lattice,
    waiting: VecDeque<IVec3>,
    queued: HashSet<IVec3>,
    /// Signs at the nodes of marched blocks, which later neighbours take over: two evaluations of
    /// a point needn't agree to the last bit, and a sign that differs would tear the mesh.
    signs: HashMap<IVec3, Box<Signs>>,
    /// Vertices on cell edges that lie in the sides of blocks, by node and axis.
    shared: HashMap<(IVec3, usize), u32>,
    mesh: Mesh,
}

impl Search<'_> {
    fn run(&mut self, field: &impl SdfBatch) -> Result<(), IsosurfaceError> {
        let mut points = Vec::new();
        while !self.waiting.is_empty() {
            let count = self.waiting.len().min(BLOCKS_AT_ONCE);
            let batch: Vec<IVec3> = self.waiting.drain(..count).collect();
            points.clear();
            for &block in &batch {
                let first = block * BLOCK as i32;
                points.extend(
                    Block::nodes().map(|node| self.lattice.place_to_ask((first + node).as_vec3())),
                );
            }
            let values = evaluate(field, &points)?;
            for (&block, values) in batch.iter().zip(values.chunks(NODES)) {
                self.march_block(block, values);
            }
        }
        Ok(())
    }

    fn march_block(&mut self, position: IVec3, values: &[f32]) {
        let lattice = self.lattice;
        let first = position * BLOCK as i32;
        let mut block = Block::new(first, values);
        if lattice.border == Border::Closed {
            block.close_border(lattice.cells);
        }
        for z in -1..=1 {
            for y in -1..=1 {
                for x in -1..=1 {
                    let offset = IVec3::new(x, y, z);
                    if let Some(signs) = self.signs.get(&(position + offset)) {
                        block.adopt_signs(offset, signs);
                    }
                }
            }
        }
        block.march(
            lattice.cells,
            |node, axis, share| {
                let mut create = || {
                    let mut at = node.as_vec3();
                    at[axis] += share;
                    self.mesh.positions.push(lattice.position(at));
                    (self.mesh.positions.len() - 1) as u32
                };
                // Inside a block, an edge's vertex is asked for once.
                if Block::edge_in_side(node - first, axis) {
                    *self.shared.entry((node, axis)).or_insert_with(create)
                } else {
                    create()
                }
            },
            &mut self.mesh.triangles,
        );
        for axis in 0..3 {
            for (side, step) in [(0, -1), (BLOCK, 1)] {
                let mut other = position;
                other[axis] += step;
                if block.side_is_cut(axis, side)
                    && lattice.has_block(other)
                    && self.queued.insert(other)
                {
                    self.waiting.push_back(other);
                }
            }
        }
        self.signs.insert(position, Box::new(block.signs()));
    }
}

/// The field at all points, in batches of bounded size.
fn evaluate(field: &impl SdfBatch, points: &[Vec3]) -> Result<Vec<f32>, IsosurfaceError> {
    let mut values = vec![0.0; points.len()];
    for (points, values) in points
        .chunks(POINTS_AT_ONCE)
        .zip(values.chunks_mut(POINTS_AT_ONCE))
    {
        field.sdf(points, values);
    }
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(values),
        Some(i) => {
            let [x, y, z] = points[i].to_array().map(|v| v.to_string());
            Err(IsosurfaceError::NotFinite { x, y, z })
        }
    }
}

/// Unit gradients at `points` from differences over the corners of a tetrahedron that fits into a cell. Where it would
/// reach out of the box, it is moved inside.
fn normals(field: &impl SdfBatch, points: &[Vec3], lattice: &Lattice) -> Vec<Vec3> {
    const CORNERS: [Vec3; 4] = [
        Vec3::new(1.0, -1.0, -1.0),
        Vec3::new(-1.0, -1.0, 1.0),
        Vec3::new(-1.0, 1.0, -1.0),
        Vec3::new(1.0, 1.0, 1.0),
    ];
    let Aabb { min, max } = lattice.aabb;
    // The same along all axes: a flat tetrahedron would take curvature for slope.
    let step = 0.5 * lattice.cell.min_element();
    let (low, high) = (min + step, max - step);
    let mut out = Vec::with_capacity(points.len());
    let (mut around, mut values) = (Vec::new(), Vec::new());
    for points in points.chunks(POINTS_AT_ONCE / CORNERS.len()) {
        around.clear();
        around.extend(points.iter().flat_map(|&p| {
            // Not `clamp`: with a single cell, rounding may put the lower bound above the upper one.
            let centre = p.max(low).min(high);
            CORNERS.map(|corner| (centre + step * corner).clamp(min, max))
        }));
        values.clear();
        values.resize(around.len(), 0.0);
        field.sdf(&around, &mut values);
        out.extend(values.chunks(CORNERS.len()).map(|values| {
            let gradient: Vec3 = CORNERS.iter().zip(values).map(|(&c, &v)| v * c).sum();
            gradient.normalize_or_zero()
        }));
    }
    out
}
