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
//! differently. The pages of docs/formats/out say where each convention is written down.

use crate::draft::Draft;
use crate::error::ExportError;
use crate::mesh::Mesh;
use crate::neus_cameras;
use crate::photos::{Accepts, Photos};
use crate::picture::{Kind, Picture};
use crate::product::MaskTool;
use crate::run::{Posed, Run};
use crate::transforms::{self, Frame};
use io_colmap::{Scene, without_ending};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Values of a mask, and what a file says about them.
struct Values {
    object: u8,
    rest: u8,
    remark: &'static str,
}

const KEEP: Values = Values {
    object: 255,
    rest: 0,
    remark: "white: the object; black: to be ignored",
};
const IGNORE: Values = Values {
    object: 0,
    rest: 255,
    remark: "white: to be ignored; black: the object",
};
const REMOVE: Values = Values {
    object: 1,
    rest: 0,
    remark: "1: the object, to be taken out; 0: what stays",
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
        MaskTool::Nerfstudio | MaskTool::Brush | MaskTool::SpinNerf => Accepts::Any,
        MaskTool::InstantNgp => Accepts::PngAndJpeg,
        MaskTool::Neus => Accepts::Png,
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
    let model_path = draft.path().join("sparse/0");
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
            photos.write(draft, "images")?;
            photos.model().write_binary(&model_path)?;
            masks(run, posed, &KEEP, draft, beside)?
        }
        MaskTool::InstantNgp => {
            // The unit cube that it renders is put around the object.
            let bounds = match Mesh::of_run(&run.root) {
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
            let mesh = Mesh::of_run(&run.root)?;
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
            let labels = spin_nerf_names(scene, names)?;
            photos.write(draft, "images")?;
            let pngs = Photos::plan(scene, posed, Accepts::Png)?;
            pngs.write(draft, "images_1")?;
            photos.model().write_binary(&model_path)?;
            notes.push("photos are not scaled down: start SPIn-NeRF with --factor 1".to_owned());
            masks(run, posed, &REMOVE, draft, |i| {
                format!("images_1/label/{}.png", labels[i])
            })?
        }
    };
    notes.extend(photos.note());
    Ok(count)
}

/// Writes every view's mask under a name.
fn masks(
    run: &Run,
    posed: &[Posed<'_>],
    values: &Values,
    draft: &Draft,
    name: impl Fn(usize) -> String + Sync,
) -> Result<usize, ExportError> {
    (0..posed.len()).into_par_iter().try_for_each(|i| {
        let matte = run.matte_of(posed[i])?;
        Picture {
            width: matte.width,
            height: matte.height,
            kind: Kind::Grey,
            remark: values.remark,
            bytes: &matte.binary(values.object, values.rest),
        }
        .write(draft, &name(i))
    })?;
    Ok(posed.len())
}

/// Its loader lists one folder, and takes a photo's name up to the first dot for its label's.
fn spin_nerf_names<'a>(scene: &Scene, names: &'a [String]) -> Result<Vec<&'a str>, ExportError> {
    let mut taken: BTreeMap<&str, &str> = BTreeMap::new();
    names
        .iter()
        .map(|name| {
            let label = name.split('.').next().unwrap_or_default();
            let other = taken.insert(label, name);
            let what = if name.contains('/') {
                "the photo is in a sub-folder, and SPIn-NeRF knows none".to_owned()
            } else if label.is_empty() {
                "the photo's name begins with a dot, and SPIn-NeRF takes what comes before".to_owned()
            } else if let Some(other) = other {
                format!(
                    "SPIn-NeRF takes photos' names up to the first dot, which is the same for {other:?}"
                )
            } else {
                return Ok(label);
            };
            Err(ExportError::bad(
                &scene.image_dir.join(name),
                what,
                "rename it in the photo folder and the model, and make the run again",
            ))
        })
        .collect()
}
