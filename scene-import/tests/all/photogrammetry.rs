//! Metashape and RealityCapture, whose lenses and angles have conventions of their own.

use crate::fixtures::{self, METASHAPE_LENS, REALITY_CAPTURE_FOCAL, REALITY_CAPTURE_LENS, import};
use crate::rig::{CENTRE, assert_sees, brown, eyes, pinhole, write_photos};
use scene_import::Format;
use std::fs;

#[test]
fn metashape_places_a_component_in_the_world() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::metashape(dir.path());
    let imported = import(dir.path(), Format::Metashape).unwrap();
    // A skew of a hundredth of a pixel is left out.
    assert_sees(&imported.model, &eyes(), 0.01, |_, p| {
        pinhole(brown(p, METASHAPE_LENS))
    });
    let dropped: Vec<&str> = imported.dropped.iter().map(|d| d.why.as_str()).collect();
    assert_eq!(
        dropped,
        ["belongs to another component than most", "was not aligned"]
    );
}

#[test]
fn what_is_ignored_is_not_taken_for_photos() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::metashape(dir.path());
    // Searched as a whole: there is no `images/`.
    fs::rename(dir.path().join("images"), dir.path().join("photos")).unwrap();
    write_photos(&dir.path().join("ignore"));
    let imported = import(dir.path(), Format::Metashape).unwrap();
    assert_eq!(imported.photos.len(), 4, "{:?}", imported.dropped);
    let photos = dir.path().join("photos");
    assert!(
        imported
            .photos
            .iter()
            .all(|photo| photo.starts_with(&photos))
    );
}

#[test]
fn metashape_lenses_that_colmap_lacks_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::metashape(dir.path());
    let path = dir.path().join("cameras.xml");
    let good = fs::read_to_string(&path).unwrap();
    for (from, to, says) in [
        ("<b2>0.01</b2>", "<b2>3.0</b2>", "without b2"),
        ("</p2>", "</p2><p3>0.1</p3>", "p3"),
        ("<f>105</f>", "<f>-105</f>", "focal length"),
        (
            "type=\"frame\" class=\"adjusted\"",
            "type=\"cylindrical\" class=\"adjusted\"",
            "cylindrical",
        ),
        (
            "sensor_id=\"0\" component_id=\"0\"",
            "sensor_id=\"7\" component_id=\"0\"",
            "not listed",
        ),
    ] {
        assert!(good.contains(from), "{from}");
        fs::write(&path, good.replace(from, to)).unwrap();
        let error = import(dir.path(), Format::Metashape)
            .unwrap_err()
            .to_string();
        assert!(error.contains(says) && error.contains("line "), "{error}");
    }
}

#[test]
fn reality_capture_angles_turn_a_camera_that_looks_down() {
    let dir = tempfile::tempdir().unwrap();
    fixtures::reality_capture(dir.path());
    let imported = import(dir.path(), Format::RealityCapture).unwrap();
    let eyes: Vec<_> = fixtures::reality_capture_eyes()
        .into_iter()
        .map(|(eye, _)| eye)
        .collect();
    assert_sees(&imported.model, &eyes, 1e-6, |_, p| {
        brown(p, REALITY_CAPTURE_LENS) * REALITY_CAPTURE_FOCAL + CENTRE
    });
    assert_eq!(imported.dropped.len(), 1);
    // Columns may be left out, but not the focal length.
    let path = dir.path().join("registration.csv");
    fs::write(
        &path,
        "#name,x,y,alt,heading,pitch,roll,f\n0001,0,0,4,0,0,0,36\n",
    )
    .unwrap();
    let imported = import(dir.path(), Format::RealityCapture).unwrap();
    assert_eq!(imported.model.cameras[&1].params, [96.0, 96.0, 48.0, 32.0]);
    fs::write(
        &path,
        "#name,x,y,alt,heading,pitch,roll,f\n0001,0,0,4,0,0,0,\n",
    )
    .unwrap();
    let error = import(dir.path(), Format::RealityCapture)
        .unwrap_err()
        .to_string();
    assert!(error.contains("line 2: f is no finite number"), "{error}");
}
