//! The rig, written in every format after its publisher's description.

use crate::rig::{CENTRE, Eye, FOCAL, HEIGHT, WIDTH, eyes, write_photo, write_photos};
use glam::{DMat3, DQuat, DVec3};
use scene_import::{Format, ImportError, Imported, detect, read};
use serde_json::{Value, json};
use std::fs;
use std::io::Write as _;
use std::path::Path;

/// Detects, checks that the format is the expected one, reads.
pub(crate) fn import(dir: &Path, format: Format) -> Result<Imported, ImportError> {
    let detected = detect(dir, None)?;
    assert_eq!(detected.format, format, "{detected:?}");
    read(&detected, None)
}

/// OpenGL's `world_from_camera`, four rows.
pub(crate) fn opengl_matrix(eye: &Eye) -> Value {
    let (r, u, b, c) = (eye.right, -eye.down, -eye.forward, eye.centre);
    json!([
        [r.x, u.x, b.x, c.x],
        [r.y, u.y, b.y, c.y],
        [r.z, u.z, b.z, c.z],
        [0.0, 0.0, 0.0, 1.0],
    ])
}

/// `transforms.json` with the rig's pinhole; the caller may change it before it is written.
pub(crate) fn transforms(dir: &Path, change: impl Fn(&mut Value)) {
    write_photos(&dir.join("images"));
    let frames: Vec<Value> = eyes()
        .iter()
        .map(|eye| {
            json!({
                "file_path": format!("images/{}.png", eye.name),
                "transform_matrix": opengl_matrix(eye),
            })
        })
        .collect();
    let mut file = json!({
        "w": WIDTH, "h": HEIGHT, "fl_x": FOCAL.x, "fl_y": FOCAL.y, "cx": CENTRE.x, "cy": CENTRE.y,
        "frames": frames,
    });
    change(&mut file);
    fs::write(dir.join("transforms.json"), file.to_string()).unwrap();
}

/// A `.npy` file of `f64`.
pub(crate) fn npy(shape: &[usize], values: &[f64]) -> Vec<u8> {
    let shape: Vec<String> = shape.iter().map(|d| format!("{d},")).collect();
    let mut header = format!(
        "{{'descr': '<f8', 'fortran_order': False, 'shape': ({}), }}",
        shape.join(" ")
    );
    while !(header.len() + 11).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

/// LLFF for photos four times as large as those in `folder`, with a focal length of 400 there.
pub(crate) fn llff(dir: &Path, folder: &str) {
    write_photos(&dir.join(folder));
    let mut values = Vec::new();
    for eye in eyes() {
        let columns = [eye.down, eye.right, -eye.forward, eye.centre];
        let hwf = [4.0 * f64::from(HEIGHT), 4.0 * f64::from(WIDTH), 400.0];
        for (row, last) in hwf.into_iter().enumerate() {
            values.extend(columns.map(|c| c[row]));
            values.push(last);
        }
        values.extend([1.0, 10.0]);
    }
    fs::write(dir.join("poses_bounds.npy"), npy(&[4, 17], &values)).unwrap();
}

/// NeuS, each matrix up to another factor.
pub(crate) fn neus(dir: &Path) {
    write_photos(&dir.join("image"));
    for eye in eyes() {
        write_photo(&dir.join(format!("mask/{}.png", eye.name)), WIDTH, HEIGHT);
    }
    let file = fs::File::create(dir.join("cameras_sphere.npz")).unwrap();
    let mut archive = zip::ZipWriter::new(file);
    for (i, (eye, factor)) in eyes().iter().zip([1.0, -3.0, 0.01, 250.0]).enumerate() {
        let row = |k: DVec3| {
            // k^T [R | -R c], with R's rows the camera's directions.
            let r = eye.right * k.x + eye.down * k.y + eye.forward * k.z;
            [r.x, r.y, r.z, -r.dot(eye.centre)].map(|v| v * factor)
        };
        let mut values: Vec<f64> = [
            DVec3::new(FOCAL.x, 0.0, CENTRE.x),
            DVec3::new(0.0, FOCAL.y, CENTRE.y),
            DVec3::Z,
        ]
        .into_iter()
        .flat_map(row)
        .collect();
        values.extend([0.0, 0.0, 0.0, 1.0]);
        let options = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Deflated);
        archive
            .start_file(format!("world_mat_{i}.npy"), options)
            .unwrap();
        archive.write_all(&npy(&[4, 4], &values)).unwrap();
        let scale = [
            2.0, 0.0, 0.0, 0.1, 0.0, 2.0, 0.0, 0.2, 0.0, 0.0, 2.0, 0.3, 0.0, 0.0, 0.0, 1.0,
        ];
        archive
            .start_file(format!("scale_mat_{i}.npy"), options)
            .unwrap();
        archive.write_all(&npy(&[4, 4], &scale)).unwrap();
    }
    archive.finish().unwrap();
}

pub(crate) fn blended_mvs(dir: &Path) {
    fs::create_dir_all(dir.join("cams")).unwrap();
    fs::write(dir.join("cams/pair.txt"), "4\n").unwrap();
    write_photos(&dir.join("blended_images"));
    for eye in eyes() {
        let masked = dir.join(format!("blended_images/{}_masked.png", eye.name));
        write_photo(&masked, WIDTH, HEIGHT);
        let mut text = "extrinsic\n".to_owned();
        for axis in [eye.right, eye.down, eye.forward] {
            text.push_str(&format!(
                "{} {} {} {}\n",
                axis.x,
                axis.y,
                axis.z,
                -axis.dot(eye.centre)
            ));
        }
        text.push_str("0.0 0.0 0.0 1.0\n\nintrinsic\n");
        text.push_str(&format!("{} 0.0 {}\n", FOCAL.x, CENTRE.x));
        text.push_str(&format!("0.0 {} {}\n0.0 0.0 1.0\n\n", FOCAL.y, CENTRE.y));
        text.push_str("1.0 0.05 128 7.4\n");
        fs::write(dir.join(format!("cams/{}_cam.txt", eye.name)), text).unwrap();
    }
}

/// CO3D with one sequence that is there and one that is not; returns the sequence's folder.
pub(crate) fn co3d(dir: &Path, intrinsics: Option<&str>) -> std::path::PathBuf {
    let sequence = dir.join("apple/12_34_56");
    write_photos(&sequence.join("images"));
    let half = glam::DVec2::new(f64::from(WIDTH), f64::from(HEIGHT)) / 2.0;
    let unit = match intrinsics {
        Some("ndc_isotropic") => glam::DVec2::splat(half.y),
        _ => half,
    };
    let focal = FOCAL / unit;
    let principal = (half - CENTRE) / unit;
    let mut frames = vec![json!({
        "sequence_name": "99_9_9", "frame_number": 0,
        "image": {"path": "apple/99_9_9/images/x.jpg", "size": [9, 9]},
        "viewpoint": null,
    })];
    for (i, eye) in eyes().iter().enumerate() {
        write_photo(
            &sequence.join(format!("masks/{}.png", eye.name)),
            WIDTH,
            HEIGHT,
        );
        // Their camera: x left, y up, z forward; a point is a row from the left.
        let columns = [-eye.right, -eye.down, eye.forward];
        let rotation: Vec<Vec<f64>> = (0..3)
            .map(|row| columns.iter().map(|c| c[row]).collect())
            .collect();
        let shift: Vec<f64> = columns.iter().map(|c| -c.dot(eye.centre)).collect();
        let mut viewpoint = json!({
            "R": rotation, "T": shift,
            "focal_length": [focal.x, focal.y], "principal_point": [principal.x, principal.y],
        });
        if let Some(word) = intrinsics {
            viewpoint["intrinsics_format"] = word.into();
        }
        frames.push(json!({
            "sequence_name": "12_34_56", "frame_number": i, "frame_timestamp": 0.1 * i as f64,
            "image": {
                "path": format!("apple/12_34_56/images/{}.png", eye.name), "size": [HEIGHT, WIDTH],
            },
            "depth": {"path": "apple/12_34_56/depths/x.png", "scale_adjustment": 1.0},
            "mask": {"path": format!("apple/12_34_56/masks/{}.png", eye.name), "mass": 100.0},
            "viewpoint": viewpoint, "meta": {"frame_type": "train_known"},
        }));
    }
    let file = fs::File::create(dir.join("apple/frame_annotations.jgz")).unwrap();
    let mut packed = flate2::write::GzEncoder::new(file, flate2::Compression::fast());
    packed
        .write_all(json!(frames).to_string().as_bytes())
        .unwrap();
    packed.finish().unwrap();
    sequence
}

/// Photos a tenth of the benchmark's size; the last has no pose near its time.
pub(crate) fn tum(dir: &Path) {
    let mut photos = "# color images\n# timestamp filename\n".to_owned();
    let mut poses = "# timestamp tx ty tz qx qy qz qw\n".to_owned();
    for (i, eye) in eyes().iter().enumerate() {
        write_photo(&dir.join(format!("rgb/{}.png", eye.name)), 64, 48);
        let time = 1_305_031_102.0 + i as f64;
        photos.push_str(&format!("{:.6} rgb/{}.png\n", time + 0.004, eye.name));
        let q = DQuat::from_mat3(&eye.axes());
        let c = eye.centre;
        for at in [time, time + 0.01] {
            poses.push_str(&format!(
                "{at:.4} {} {} {} {} {} {} {}\n",
                c.x, c.y, c.z, q.x, q.y, q.z, q.w
            ));
        }
    }
    write_photo(&dir.join("rgb/late.png"), 64, 48);
    photos.push_str("1305031199.5 rgb/late.png\n1305031199.6 rgb/gone.png\n");
    fs::write(dir.join("rgb.txt"), photos).unwrap();
    fs::write(dir.join("groundtruth.txt"), poses).unwrap();
}

/// What Metashape's own frame is turned, scaled and moved by.
pub(crate) fn metashape_world() -> (DMat3, DVec3, f64) {
    let rotation = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.2, -0.7, 1.9));
    (rotation, DVec3::new(5.0, -2.0, 1.0), 2.5)
}

/// Brown's coefficients `K1 K2 P2 P1 K3`, that is OpenCV's order of `k1 k2 p1 p2 k3`.
pub(crate) const METASHAPE_LENS: [f64; 5] = [-0.11, 0.05, 1e-3, -2e-3, -0.01];

pub(crate) fn metashape(dir: &Path) {
    write_photos(&dir.join("images"));
    let (rotation, shift, scale) = metashape_world();
    let cameras: Vec<String> = eyes()
        .iter()
        .enumerate()
        .map(|(i, eye)| {
            let axes = rotation.transpose() * eye.axes();
            let c = rotation.transpose() * (eye.centre - shift) / scale;
            let (x, y, z) = (axes.x_axis, axes.y_axis, axes.z_axis);
            format!(
                r#"<camera id="{i}" sensor_id="0" component_id="0" label="{}"><transform>{} {} {} {} {} {} {} {} {} {} {} {} 0 0 0 1</transform></camera>"#,
                eye.name, x.x, y.x, z.x, c.x, x.y, y.y, z.y, c.y, x.z, y.z, z.z, c.z
            )
        })
        .collect();
    let r: Vec<String> = rotation
        .transpose()
        .to_cols_array()
        .iter()
        .map(f64::to_string)
        .collect();
    let [k1, k2, p2, p1, k3] = METASHAPE_LENS;
    let text = format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<document version="1.5.0">
  <chunk label="Chunk 1" enabled="true">
    <sensors next_id="1">
      <sensor id="0" label="unknown" type="frame">
        <resolution width="{WIDTH}" height="{HEIGHT}"/>
        <calibration type="frame" class="initial">
          <resolution width="{WIDTH}" height="{HEIGHT}"/><f>1</f>
        </calibration>
        <calibration type="frame" class="adjusted">
          <resolution width="{WIDTH}" height="{HEIGHT}"/>
          <f>{}</f><cx>{}</cx><cy>{}</cy><b1>{}</b1><b2>0.01</b2>
          <k1>{k1}</k1><k2>{k2}</k2><k3>{k3}</k3><p1>{p1}</p1><p2>{p2}</p2>
        </calibration>
      </sensor>
    </sensors>
    <components next_id="2" active_id="0">
      <component id="0" label="Component 1"><transform>
        <rotation locked="true">{}</rotation>
        <translation>{} {} {}</translation><scale>{scale}</scale>
      </transform></component>
    </components>
    <cameras next_id="6" next_group_id="1">
      {}
      <group id="0" label="Group" type="folder">{}</group>
      <camera id="4" sensor_id="0" component_id="1" label="other">
        <transform>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform></camera>
      <camera id="5" sensor_id="0" label="unaligned"/>
    </cameras>
  </chunk>
</document>"#,
        FOCAL.y,
        CENTRE.x - f64::from(WIDTH) / 2.0,
        CENTRE.y - f64::from(HEIGHT) / 2.0,
        FOCAL.x - FOCAL.y,
        r.join(" "),
        shift.x,
        shift.y,
        shift.z,
        cameras[..2].join("\n"),
        cameras[2..].join("\n"),
    );
    fs::write(dir.join("cameras.xml"), text).unwrap();
}

/// Cameras of which one can say without computing where they look: name, angles, and the world's
/// directions of the picture's right, down and depth.
pub(crate) fn reality_capture_eyes() -> Vec<(Eye, [f64; 3])> {
    let eye = |name: &str, angles: [f64; 3], right: DVec3, down: DVec3| {
        let forward = right.cross(down);
        let centre = -4.0 * forward + DVec3::new(0.1, 0.2, 0.3);
        let name = name.to_owned();
        (
            Eye {
                name,
                right,
                down,
                forward,
                centre,
            },
            angles,
        )
    };
    vec![
        // Straight down, north up.
        eye("0001", [0.0, 0.0, 0.0], DVec3::X, -DVec3::Y),
        // Straight down, turned clockwise to east.
        eye("0002", [90.0, 0.0, 0.0], -DVec3::Y, -DVec3::X),
        // Level, to the north.
        eye("0003", [0.0, 90.0, 0.0], DVec3::X, -DVec3::Z),
        // Level, to the east.
        eye("0004", [90.0, 90.0, 0.0], -DVec3::Y, -DVec3::Z),
        // Straight down, rolled to the west.
        eye("0005", [0.0, 0.0, 90.0], -DVec3::Z, -DVec3::Y),
    ]
}

/// `k1 k2 p1 p2 k3`, as OpenCV has them.
pub(crate) const REALITY_CAPTURE_LENS: [f64; 5] = [0.04, -0.02, 5e-4, -1e-3, 0.01];
pub(crate) const REALITY_CAPTURE_FOCAL: f64 = 100.0;

pub(crate) fn reality_capture(dir: &Path) {
    // The tangential ones the other way round.
    let [k1, k2, t2, t1, k3] = REALITY_CAPTURE_LENS;
    let longer = f64::from(WIDTH);
    let mut text =
        "#cameras 6\n#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\n".to_owned();
    for (eye, [heading, pitch, roll]) in reality_capture_eyes() {
        write_photo(&dir.join(format!("images/{}.png", eye.name)), WIDTH, HEIGHT);
        text.push_str(&format!(
            "{}.png,{},{},{},{heading},{pitch},{roll},{},{},{},{k1},{k2},{k3},0,{t1},{t2}\n",
            eye.name,
            eye.centre.x,
            eye.centre.y,
            eye.centre.z,
            REALITY_CAPTURE_FOCAL * 36.0 / longer,
            (CENTRE.x - f64::from(WIDTH) / 2.0) / longer,
            (CENTRE.y - f64::from(HEIGHT) / 2.0) / longer,
        ));
    }
    text.push_str("gone.png,0,0,0,0,0,0,30,0,0,0,0,0,0,0,0\n");
    fs::write(dir.join("registration.csv"), text).unwrap();
}
