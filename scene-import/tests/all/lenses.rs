//! The camera models that transforms.json knows.

use crate::fixtures::{self, import};
use crate::rig::{CENTRE, FOCAL, HEIGHT, WIDTH, assert_sees, brown, eyes, pinhole};
use glam::DVec2;
use io_colmap::CameraModel;
use scene_import::{Format, Imported};
use serde_json::{Value, json};

fn with_lens(lens: &Value) -> Result<Imported, scene_import::ImportError> {
    let dir = tempfile::tempdir().unwrap();
    fixtures::transforms(dir.path(), |file| {
        for (key, value) in lens.as_object().unwrap() {
            file[key] = value.clone();
        }
    });
    import(dir.path(), Format::Transforms)
}

fn model_of(imported: &Imported) -> CameraModel {
    imported.model.cameras[&1].model
}

#[test]
fn perspective_lenses_with_browns_distortion() {
    for (names, lens) in [
        (&["PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE"][..], [0.0; 5]),
        (
            &["OPENCV", "SIMPLE_RADIAL", "RADIAL"],
            [0.1, -0.05, 0.0, 0.0, 0.0],
        ),
        (&["OPENCV"], [0.0578, -0.0805, -9.8e-4, 1.6e-4, 0.0]),
        (&["OPENCV"], [0.1, -0.05, 2e-3, -1e-3, 0.02]),
    ] {
        for name in names {
            let [k1, k2, p1, p2, k3] = lens;
            let stated =
                json!({"camera_model": name, "k1": k1, "k2": k2, "p1": p1, "p2": p2, "k3": k3});
            let imported = with_lens(&stated).unwrap();
            assert_sees(&imported.model, &eyes(), 1e-6, |_, p| {
                pinhole(brown(p, lens))
            });
        }
    }
}

#[test]
fn a_fourth_radial_term_is_kept_to_a_twentieth_of_a_pixel() {
    let k = [-0.2, 0.08, -0.02, 0.006];
    let imported =
        with_lens(&json!({"k1": k[0], "k2": k[1], "k3": k[2], "k4": k[3], "p1": 1e-3})).unwrap();
    assert_eq!(model_of(&imported), CameraModel::FullOpenCv);
    assert_sees(&imported.model, &eyes(), 0.05, |_, p| {
        let t = p.length_squared();
        pinhole(brown(p, [k[0], k[1], 1e-3, 0.0, k[2]]) + p * k[3] * t.powi(4))
    });
}

#[test]
fn fisheye_lenses() {
    let k = [0.02, -0.01, 0.003, -0.0005];
    let equidistant = |p: DVec2| {
        let theta = p.length().atan();
        let t = theta * theta;
        let bent = theta * (1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3]))));
        p.normalize_or_zero() * bent
    };
    let stated = json!({"k1": k[0], "k2": k[1], "k3": k[2], "k4": k[3]});
    for kind in [
        json!({"camera_model": "OPENCV_FISHEYE"}),
        json!({"is_fisheye": true}),
    ] {
        let mut lens = stated.clone();
        lens.as_object_mut()
            .unwrap()
            .extend(kind.as_object().unwrap().clone());
        let imported = with_lens(&lens).unwrap();
        assert_eq!(model_of(&imported), CameraModel::OpenCvFisheye);
        assert_sees(&imported.model, &eyes(), 1e-6, |_, p| {
            equidistant(p) * FOCAL + CENTRE
        });
    }
    // Aria's: only the radial terms, of which the fifth and sixth are further powers.
    let params = json!([k[0], k[1], k[2], k[3], 0, 0, 0, 0, 0, 0, 0, 0]);
    let imported =
        with_lens(&json!({"camera_model": "FISHEYE624", "distortion_params": params})).unwrap();
    assert_eq!(model_of(&imported), CameraModel::RadTanThinPrismFisheye);
    assert_sees(&imported.model, &eyes(), 1e-6, |_, p| {
        equidistant(p) * FOCAL + CENTRE
    });
}

#[test]
fn panoramas() {
    let imported = with_lens(&json!({"camera_model": "EQUIRECTANGULAR"})).unwrap();
    assert_sees(&imported.model, &eyes(), 1e-6, |_, p| {
        let longitude = p.x.atan();
        let latitude = p.y.atan2(p.x.hypot(1.0));
        DVec2::new(
            (longitude / std::f64::consts::TAU + 0.5) * f64::from(WIDTH),
            (latitude / std::f64::consts::PI + 0.5) * f64::from(HEIGHT),
        )
    });
}

#[test]
fn lenses_that_mean_nothing_are_refused_with_the_frame() {
    for (lens, says) in [
        (json!({"camera_model": "MAGIC"}), "MAGIC"),
        (
            json!({"camera_model": "ORTHOPHOTO"}),
            "centre of projection",
        ),
        (
            json!({"camera_model": "FISHEYE624"}),
            "12 distortion_params",
        ),
        (json!({"fl_x": null, "fl_y": null}), "camera_angle_x"),
        (json!({"fl_x": -1.0}), "focal length"),
        (
            json!({"camera_angle_x": 0.0, "fl_x": null, "fl_y": null}),
            "parameter inf",
        ),
        (json!({"w": 0}), "picture size"),
        (json!({"w": 1e12}), "picture size"),
        (json!({"w": 64, "h": 96}), "another shape"),
        (
            json!({"k1": 1.0, "k4": 1e300}),
            "distortion cannot be fitted",
        ),
    ] {
        let error = with_lens(&lens).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
        assert!(error.contains("0001") && error.contains(';'), "{error}");
    }
}
