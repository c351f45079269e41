//! The sections of the configuration. Names here are the keys of `config.toml` and `--set`.

use hashgrid::{Hash, MomentPrecision, TableReads};
use serde::{Deserialize, Serialize};

/// How a hash grid is read between its vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Interpolation {
    /// Trilinear: normals jump at cell borders.
    Linear,
    /// Trilinear in smoothstepped coordinates: continuous normals.
    Smoothstep,
}

/// Which fields explain the photos.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fields {
    /// FoCoR and BaCo, as the method has them.
    Both,
    /// FoCoR alone: nothing explains what is not the object, so that only pixels that the masks take
    /// for the object teach colours, and the mask loss alone says where it ends.
    Object,
    /// One field for the whole scene, each of whose places is the object's by a share that is learnt
    /// from the coarse masks (Semantic-NeRF, Zhi et al. 2021): see `train::semantic`.
    Semantic,
}

/// What makes a field opaque.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Transparency {
    /// A signed distance and NeuS alpha, as in the paper.
    Sdf,
    /// A volume density, as in NeRF.
    Density,
}

/// Which number is the matte.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AlphaSource {
    /// The colour network's fourth output, as in the paper's equations 2 and 3.
    Head,
    /// The accumulated opacity of the object's surface: agrees with the mesh.
    Opacity,
    /// The product of both.
    Both,
}

/// How the two fields become one colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Blend {
    /// Each field is rendered alone and the results are mixed by alpha, as in the paper's figure.
    Ray,
    /// Samples of both fields are composited in depth order: right for things in front of the object.
    Sample,
}

/// How far a rendered colour is from the photo's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColourLoss {
    /// Squared difference.
    L2,
    /// Squared near zero, linear beyond `huber_delta`.
    Huber,
    /// Absolute difference.
    L1,
}

/// Where m^P comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ProbabilitySource {
    /// The soft visual hull of the masks, for the whole run.
    Hull,
    /// The hull at first, then the votes of the masks on the surfaces that their pixels show.
    Surface,
}

/// From which share of its votes on a place is the object's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Majority {
    /// More than half.
    Half,
    /// As many as masks that err to one side more often than to the other call for.
    Fitted,
}

/// Which cameras are moved to where their photos show them to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CameraRefinement {
    /// None, as in the paper.
    Never,
    /// Those that seem to be off by more than the fields' own errors.
    Auto,
    /// All.
    Always,
}

/// `[model]`: the fields and how their colours meet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Levels of each hash grid; 0 chooses them from the footprint of a pixel.
    pub levels: u32,
    /// Cells along the box at the coarsest level.
    pub base_resolution: u32,
    /// Cells along the box at the finest level; 0 chooses it from the footprint of a pixel.
    pub finest_resolution: u32,
    /// Binary logarithm of the entries a level's table has at most.
    pub log2_table_size: u32,
    /// Whether a fine level's nodes are hashed one by one, as in the paper, or in blocks of 2x2x2.
    pub hash: Hash,
    /// What kernels on GPUs read of the tables; the CPU reads them as they are.
    pub table_reads: TableReads,
    /// Degree of the spherical harmonics of view directions that colours depend on, up to 4; 1: the
    /// direction alone, as in the paper.
    pub direction_degree: u32,
    /// How a grid is read between its vertices.
    pub interpolation: Interpolation,
    /// Width of every hidden layer.
    pub hidden: u32,
    /// Features the object's distance network hands to its colour network.
    pub object_features: u32,
    /// The same for the background.
    pub background_features: u32,
    /// Which fields explain the photos.
    pub fields: Fields,
    /// What makes the object's field opaque.
    pub foreground: Transparency,
    /// What makes the background field opaque.
    pub background: Transparency,
    /// Which number is the matte.
    pub alpha: AlphaSource,
    /// Who says which part of space is the object's; without both fields it is the hull.
    pub probability: ProbabilitySource,
    /// From which share of its votes on a place is the object's.
    pub majority: Majority,
    /// How the two fields become one colour.
    pub blend: Blend,
}

impl ModelConfig {
    /// What makes the object opaque, whichever field it is in.
    #[must_use]
    pub fn object_transparency(&self) -> Transparency {
        match self.fields {
            Fields::Both | Fields::Object => self.foreground,
            Fields::Semantic => self.background,
        }
    }
}

/// `[loss]`: weights and shapes of the losses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossConfig {
    /// Shape of the colour loss, whose weight is 1.
    pub colour: ColourLoss,
    /// Where the Huber loss turns linear, in sRGB units of 0..1.
    pub huber_delta: f32,
    /// Weight of (|gradient| - 1)^2 on the object's distance.
    pub eikonal: f32,
    /// The same on the background's.
    pub eikonal_background: f32,
    /// Weight of exp(-tau |distance|), which keeps unseen space off the surface.
    pub sparsity: f32,
    /// The tau of it, per normalised unit.
    pub sparsity_tau: f32,
    /// Weight of the coarse masks while they count fully.
    pub mask: f32,
    /// Share of the run during which the masks count fully.
    pub mask_hold: f32,
    /// Share of the run at which their weight has fallen to `mask_floor`.
    pub mask_end: f32,
    /// The weight's fraction that stays from then on.
    pub mask_floor: f32,
    /// Weight of the masks once there is an object, as far as they agree with it (see
    /// `train::agreement`).
    pub mask_trusted: f32,
    /// Width of the band along mask edges where masks say nothing, as a share of the object's size.
    pub ignore_band: f32,
    /// Weight of the distortion loss: light should come from one place on each ray.
    pub distortion: f32,
    /// Weight of light coming from far outside the box, while BaCo finds the geometry.
    pub far: f32,
    /// Weight of what hides the object where its mask says that it is to be seen, less where light comes from the background in
    /// the box, and where its colours show it.
    pub hidden: f32,
    /// Weight of light from elsewhere than the sparse points that views are known to see.
    pub sight: f32,
    /// Weight of distance = 0 at sparse points on the object.
    pub points: f32,
    /// Weight of normals that differ between neighbouring places of the object.
    pub curvature: f32,
    /// Weight of the background's own colour loss outside the masks.
    pub background: f32,
    /// Weight of the cross entropy between a semantic field's share and the coarse masks.
    pub semantic: f32,
}

/// `[schedule]`: what changes in the course of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScheduleConfig {
    /// Learning rate of the hash tables at its peak.
    pub learning_rate: f32,
    /// The same of the networks.
    pub learning_rate_mlp: f32,
    /// How a CPU keeps the moments of the tables' Adam.
    pub moments: MomentPrecision,
    /// Steps over which rates rise to their peak.
    pub warmup_steps: u32,
    /// Rates at the end, relative to the peak.
    pub final_ratio: f32,
    /// Hash levels that are on from the start.
    pub first_levels: u32,
    /// Share of the run that BaCo learns the whole scene by itself, before FoCoR is carved out of it;
    /// 0 starts both together.
    pub carve: f32,
    /// Share of the run after which votes on surfaces replace the visual hull as m^P.
    pub votes_start: f32,
    /// Share of the run from which colours begin to depend on the direction they are seen from:
    /// before, they could explain away a surface that is not yet where it belongs.
    pub view_start: f32,
    /// Share of the run at which they do so fully.
    pub view_end: f32,
    /// Share of the run by which all levels are on.
    pub levels_end: f32,
    /// Share of the run over which the cosine in NeuS' alpha is annealed; 0 turns annealing off.
    pub cos_anneal_end: f32,
    /// Learning rate of the sharpness s.
    pub sharpness_learning_rate: f32,
    /// Where s starts; NeuS' b is exp(10 s).
    pub sharpness_start: f32,
}

/// `[sampling]`: rays and samples of a step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SamplingConfig {
    /// Rays of the first step; later ones follow `target_samples`.
    pub rays: u32,
    /// Rays that no step exceeds.
    pub most_rays: u32,
    /// Samples of both fields a step aims for, those that others stand for included.
    pub target_samples: u32,
    /// Marching steps across the object's box.
    pub object_steps: u32,
    /// Background samples along a ray.
    pub background_samples: u32,
    /// Share of the rays that are drawn around the object.
    pub object_share: f32,
    /// Share of the rays that go to sparse points which their views are known to see, where `loss.sight` is not 0.
    pub sight_share: f32,
    /// Of a surface's samples that nothing shows at, the share that a step learns from; they count for the others.
    pub clear_share: f32,
    /// Cells along each side of the occupancy grid.
    pub occupancy_resolution: u32,
    /// Steps between its updates.
    pub occupancy_every: u32,
}

/// `[prepare]`: how the object's box is found from masks and sparse points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PrepareConfig {
    /// Photos are trained on at this part of their size each way; results are of their own size.
    pub downscale: u32,
    /// Whether cameras are aligned with the photos while the fields learn (see `train::cameras`).
    pub refine_cameras: CameraRefinement,
    /// Share of the views seeing a point whose masks must agree for it to lie in the hull.
    pub hull_threshold: f32,
    /// The same for it to be the object's rather than the background's.
    pub object_threshold: f32,
    /// Probability above which the background field is cut open.
    pub crop_threshold: f32,
    /// What is added around the object on each side, as a share of its size.
    pub box_margin: f32,
    /// Masks that are too small, or too large, all around are moved to where geometry ends.
    pub fit_masks: bool,
    /// Where masks seem to fill in openings of the object, they have no vote.
    pub find_openings: bool,
    /// Where masks leak into surroundings without an edge, they have no vote.
    pub find_leaks: bool,
}

/// `[export]`: what is written, and how often.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExportConfig {
    /// Rays per pixel along the matte's edge.
    pub edge_rays: u32,
    /// Over how many pixels the object's opacity may fall off across its outline, before edges are supersampled; 0 for
    /// as many as it does in training (see `render::edge_width`).
    pub edge_width: f32,
    /// Cells along the longest side of the box when the mesh is cut.
    pub mesh_resolution: u32,
    /// Mattes end where their photo shows an outline, if that is close by (see `render::photo_outline`).
    pub follow_photos: bool,
    /// Where fewer than three views saw what the object hid, plates are filled in from around.
    pub fill_unseen: bool,
    /// Steps between two previews; 0 for none.
    pub preview_every: u32,
    /// Steps between two checkpoints; 0 for one at the end only.
    pub checkpoint_every: u32,
}
