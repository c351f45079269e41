//! Masks under the names, and with the meaning, that each tool gives them.
//!
//! | tool | file | the object | the rest | beside it |
//! |---|---|---|---|---|
//! | COLMAP | `masks/NAME.jpg.png` | 255: features are taken | 0: ignored | |
//! | nerfstudio | `masks/NAME.png`, `mask_path` | 255: trained on | 0: ignored | photos, `transforms.json` |
//! | Brush | `masks/NAME.png` | 255: trained on | 0: ignored | photos, `sparse/0` |
//! | instant-ngp | `images/dynamic_mask_NAME.png` | 0: trained on | 255: ignored | photos, `transforms.json` |
//! | NeuS | `mask/000.png` | 255: object | 0: background | `image/000.png`, `cameras_sphere.npz` |
//! | SPIn-NeRF | `images_1/label/NAME.png` | 1: taken out | 0: stays | photos, `sparse/0` |
//!
//! All are 8-bit grey, of the photo's size, and hold no values between: these tools threshold
//! differently. SPIn-NeRF has none of views that do not show the object. The pages of docs/formats/out
//! say where each convention is written down.

use crate::brush_names;
use crate::draft::Draft;
use crate::error::ExportError;
use crate::mesh::mesh_of_run;
use crate::neus_cameras;
use crate::photos::{Accepts, Photos};
use crate::picture::{Kind, Picture};
use crate::product::MaskTool;
use crate::run::{Posed, Run};
use crate::spin_nerf;
use crate::transforms::{self, Frame};
use io_colmap::{Scene, without_ending};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Values of a mask, and what a file says about them.
struct Values {
    object: u8,
    rest: u8,
    remark: &'static str,
    /// Whether a view that does not show the object has none.
    only_where_seen: bool,
}

const KEEP: Values = Values {
    object: 255,
    rest: 0,
    remark: "white: the object; black: to be ignored",
    only_where_seen: false,
};
const IGNORE: Values = Values {
    object: 0,
    rest: 255,
    remark: "white: to be ignored; black: the object",
    only_where_seen: false,
};
const REMOVE: Values = Values {
    object: 1,
    rest: 0,
    remark: "1: the object, to be taken out; 0: what stays",
    // SPIn-NeRF divides labels by their largest value, and whatever it mixes with the result of 0 / 0 is no number
    // either. Of a view without a label it knows what to think.
    only_where_seen: true,
};

/// Writes what a tool needs to use the run's mattes as masks; returns how many masks.
pub(crate) fn write(
    tool: MaskTool,
    run: &Run,
    scene: &Scene,
    posed: &[Posed<'_>],
    draft: &Draft,
    notes: &mut Vec<String>,
) -> Result<usize, ExportError> {
    let accepts = match tool {
        MaskTool::Colmap => {
            let name = |i: usize| format!("masks/{}.png", posed[i].view.name);
            return masks(run, posed, &KEEP, draft, name);
        }
        MaskTool::Nerfstudio | MaskTool::Brush => Accepts::ANY,
        MaskTool::InstantNgp => Accepts::PNG_AND_JPEG,
        MaskTool::Neus => Accepts::PNG,
        MaskTool::SpinNerf => Accepts::LISTED,
    };
    let photos = Photos::plan(scene, posed, accepts)?;
    let names = &photos.names;
    let beside = |i: usize| format!("masks/{}.png", without_ending(&names[i]));
    let frames = |mask: &dyn Fn(usize) -> Option<String>| -> Vec<Frame<'_>> {
        let frame = |(i, posed): (usize, &Posed<'_>)| Frame {
            camera: scene.model.cameras.get(&posed.view.camera_id),
            pose: posed.view.camera_from_world,
            photo: format!("images/{}", names[i]),
            mask: mask(i),
        };
        posed.iter().enumerate().map(frame).collect()
    };
    let count = match tool {
        MaskTool::Colmap => 0,
        MaskTool::Nerfstudio => {
            transforms::write(
                tool,
                &frames(&|i| Some(beside(i))),
                None,
                &scene.root,
                draft,
            )?;
            photos.write(draft, "images")?;
            masks(run, posed, &KEEP, draft, beside)?
        }
        MaskTool::Brush => {
            brush_names::check(scene, posed, names)?;
            photos.write(draft, "images")?;
            draft.write_model(&photos.model(), "sparse/0")?;
            masks(run, posed, &KEEP, draft, beside)?
        }
        MaskTool::InstantNgp => {
            // The unit cube that it renders is put around the object.
            let bounds = match mesh_of_run(&run.root) {
                Ok(mesh) => Some(mesh.bounds()),
                Err(error) => {
                    notes.push(format!(
                        "the mesh does not say where the object is ({error}), so set scale and offset in \
                         transforms.json so that it lies in the unit cube"
                    ));
                    None
                }
            };
            transforms::write(tool, &frames(&|_| None), bounds, &scene.root, draft)?;
            photos.write(draft, "images")?;
            masks(run, posed, &IGNORE, draft, |i| {
                let stem = without_ending(&names[i]);
                match stem.rsplit_once('/') {
                    Some((folder, stem)) => format!("images/{folder}/dynamic_mask_{stem}.png"),
                    None => format!("images/dynamic_mask_{stem}.png"),
                }
            })?
        }
        MaskTool::Neus => {
            let mesh = mesh_of_run(&run.root)?;
            neus_cameras::write(scene, posed, &mesh, draft)?;
            let digits = posed.len().saturating_sub(1).to_string().len().max(3);
            photos.write_as(draft, |i| format!("image/{i:0digits$}.png"))?;
            notes.push(format!(
                "photos are numbered in the order of their names, from {:?}",
                posed.first().map_or("", |posed| posed.view.name.as_str())
            ));
            masks(run, posed, &KEEP, draft, |i| {
                format!("mask/{i:0digits$}.png")
            })?
        }
        MaskTool::SpinNerf => {
            let labels = spin_nerf::labels(scene, names)?;
            spin_nerf::check_cameras(scene, posed)?;
            spin_nerf::check_points(scene, posed)?;
            let count = masks(run, posed, &REMOVE, draft, |i| {
                format!("images_1/label/{}.png", labels[i])
            })?;
            notes.push("photos are not scaled down: start SPIn-NeRF with --factor 1".to_owned());
            notes.extend(spin_nerf::unlabelled(run, count, posed.len())?);
            photos.write(draft, "images")?;
            let pngs = Photos::plan(scene, posed, Accepts::LISTED_PNG)?;
            pngs.write(draft, "images_1")?;
            draft.write_model(&spin_nerf::numbered(photos.model()), "sparse/0")?;
            count
        }
    };
    notes.extend(photos.notes());
    Ok(count)
}

/// Writes every view's mask under a name; returns how many.
fn masks(
    run: &Run,
    posed: &[Posed<'_>],
    values: &Values,
    draft: &Draft,
    name: impl Fn(usize) -> String + Sync,
) -> Result<usize, ExportError> {
    let count = AtomicUsize::new(0);
    (0..posed.len()).into_par_iter().try_for_each(|i| {
        let matte = run.matte_of(posed[i])?;
        let bytes = matte.binary(values.object, values.rest);
        if values.only_where_seen && !bytes.contains(&values.object) {
            return Ok(());
        }
        count.fetch_add(1, Ordering::Relaxed);
        Picture {
            width: matte.width,
            height: matte.height,
            kind: Kind::Grey,
            remark: values.remark,
            bytes: &bytes,
        }
        .write(draft, &name(i))
    })?;
    Ok(count.into_inner())
}
