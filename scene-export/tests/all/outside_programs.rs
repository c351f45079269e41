//! What other programs read of it, where they are installed: Python with pycocotools, OpenEXR, trimesh
//! or numpy, the Khronos validator of glTF, and COLMAP. `SOS_PYTHON` names another interpreter than `python3`;
//! `NODE_PATH` is where Node.js finds the validator.

use crate::rig::{Rig, alpha};
use scene_export::{MaskTool, Target};
use std::path::Path;
use std::process::Command;

/// Runs a script that needs a Python module; `None`, with the reason printed, where that is missing.
fn python(module: &str, script: &str, folder: &Path) -> Option<String> {
    let interpreter = std::env::var("SOS_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    ask(
        &interpreter,
        "-c",
        &format!("import {module}"),
        script,
        folder,
    )
}

/// Runs a script with an interpreter, unless the first line of it fails, which loads what it needs.
fn ask(interpreter: &str, option: &str, load: &str, script: &str, folder: &Path) -> Option<String> {
    let run = |code: &str| {
        let mut command = Command::new(interpreter);
        command.args([option, code]).arg(folder).output()
    };
    match run(load) {
        Ok(output) if output.status.success() => {}
        Ok(_) => {
            println!("skipped: {interpreter} cannot do {load:?}");
            return None;
        }
        Err(error) => {
            println!("skipped: {interpreter} does not start ({error})");
            return None;
        }
    }
    let output = run(script).unwrap();
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{complaint}");
    Some(String::from_utf8(output.stdout).unwrap().trim().to_owned())
}

#[test]
fn pycocotools_decodes_the_masks() {
    let rig = Rig::new();
    let (out, _) = rig.files(Target::Coco);
    let script = "
import sys
from pycocotools.coco import COCO
coco = COCO(sys.argv[1] + '/coco.json')
for a in coco.loadAnns(coco.getAnnIds()):
    mask = coco.annToMask(a)
    assert mask.sum() == a['area']
    print('mask', a['image_id'], ''.join(str(v) for v in mask.flatten()))
";
    let Some(said) = python("pycocotools", script, &out) else {
        return;
    };
    let masks: Vec<&str> = said
        .lines()
        .filter_map(|l| l.strip_prefix("mask "))
        .collect();
    assert_eq!(masks.len(), 3);
    let wanted: String = (0..30 * 40)
        .map(|i| {
            if alpha(0, i % 40, i / 40) >= 32768 {
                '1'
            } else {
                '0'
            }
        })
        .collect();
    assert_eq!(masks[0], format!("1 {wanted}"));
}

#[test]
fn openexr_reads_the_layers() {
    let rig = Rig::new();
    let (out, _) = rig.files(Target::Exr);
    let script = "
import sys, OpenEXR
with OpenEXR.File(sys.argv[1] + '/000.exr', separate_channels=True) as f:
    c = f.channels()
    print(sorted(c), c['A'].pixels.dtype, c['R'].pixels.dtype, c['id'].pixels.dtype, c['A'].pixels[15, 20])
    h = f.header()
    assert 'premultiplied' in h['comments'] and h['sos:alpha'] == 'premultiplied', h
    assert abs(h['chromaticities'][0] - 0.64) < 1e-6
";
    let Some(said) = python("OpenEXR", script, &out) else {
        return;
    };
    assert_eq!(
        said,
        "['A', 'B', 'G', 'N.X', 'N.Y', 'N.Z', 'R', 'Z', 'background.B', 'background.G', \
         'background.R', 'id'] float32 float16 uint32 1.0"
    );
}

#[test]
fn trimesh_reads_the_meshes() {
    for (target, file) in [(Target::Obj, "mesh.obj"), (Target::Glb, "mesh.glb")] {
        let rig = Rig::new();
        let (out, _) = rig.files(target);
        let script = format!(
            "
import sys, trimesh
mesh = trimesh.load(sys.argv[1] + '/{file}', force='mesh', process=False)
print(len(mesh.vertices), len(mesh.faces), mesh.is_watertight, mesh.bounds.tolist(),
      round(mesh.volume, 6))
# Of a mesh with a material it keeps no vertex colours.
if '{file}' == 'mesh.obj':
    assert mesh.visual.vertex_colors[0].tolist() == [255, 0, 0, 255]
"
        );
        let Some(said) = python("trimesh", &script, &out) else {
            return;
        };
        assert_eq!(
            said, "6 8 True [[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]] 0.166667",
            "{file}"
        );
    }
}

#[test]
fn numpy_reads_the_cameras() {
    let rig = Rig::new();
    let (out, _) = rig.masks(MaskTool::Neus);
    let script = "
import sys, numpy
f = numpy.load(sys.argv[1] + '/cameras_sphere.npz')
p = f['world_mat_0'] @ f['scale_mat_0'] @ numpy.array([0, 0, 0, 1.0])
print(len(f.files), f['world_mat_0'].shape, (p[:2] / p[2]).tolist())
";
    let Some(said) = python("numpy", script, &out) else {
        return;
    };
    assert_eq!(said, "8 (4, 4) [20.5, 15.5]");
}

#[test]
fn the_khronos_validator_finds_nothing() {
    let rig = Rig::new();
    let (out, _) = rig.files(Target::Glb);
    let load = "require('gltf-validator')";
    let script = "
const fs = require('fs');
const bytes = new Uint8Array(fs.readFileSync(process.argv[1] + '/mesh.glb'));
require('gltf-validator').validateBytes(bytes).then(r => console.log(
  r.issues.numErrors, r.issues.numWarnings, r.issues.numInfos, r.issues.numHints,
  JSON.stringify(r.issues.messages)));
";
    if let Some(said) = ask("node", "-e", load, script, &out) {
        assert_eq!(said, "0 0 0 0 []");
    }
}

#[test]
fn colmap_reads_the_scene() {
    let rig = Rig::new();
    let (out, _) = rig.files(Target::ColmapScene);
    let converted = tempfile::tempdir().unwrap();
    let output = Command::new("colmap")
        .args(["model_converter", "--output_type", "TXT", "--input_path"])
        .arg(out.join("sparse/0"))
        .arg("--output_path")
        .arg(converted.path())
        .output();
    let output = match output {
        Ok(output) => output,
        Err(error) => {
            println!("skipped: colmap does not start ({error})");
            return;
        }
    };
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{complaint}");
    let rows = |name: &str| -> Vec<Vec<String>> {
        let text = std::fs::read_to_string(converted.path().join(name)).unwrap();
        let rows = text.lines().filter(|line| !line.starts_with('#'));
        rows.map(|line| line.split_whitespace().map(str::to_owned).collect())
            .collect()
    };
    let model = io_colmap::Scene::open(&out).unwrap().model;
    // ID, quaternion, translation, camera, name; then a line of observations.
    let images = rows("images.txt");
    let images: Vec<&Vec<String>> = images.iter().step_by(2).collect();
    assert_eq!(images.len(), model.views.len());
    for view in &model.views {
        let row = images.iter().find(|row| row[9] == view.name).unwrap();
        let number = |i: usize| row[i].parse::<f64>().unwrap();
        let rotation = view.camera_from_world.rotation;
        let dot = rotation.w * number(1)
            + rotation.x * number(2)
            + rotation.y * number(3)
            + rotation.z * number(4);
        assert!((dot.abs() - 1.0).abs() < 1e-9, "{}: turned", view.name);
        for (i, value) in view
            .camera_from_world
            .translation
            .to_array()
            .iter()
            .enumerate()
        {
            assert!((value - number(5 + i)).abs() < 1e-9, "{}: moved", view.name);
        }
    }
    assert_eq!(rows("cameras.txt").len(), model.cameras.len());
    assert_eq!(rows("points3D.txt").len(), model.points.len());
}
