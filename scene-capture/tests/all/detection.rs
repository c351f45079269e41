//! What a path is taken for.

use scene_capture::{Source, detect};
use std::fs;

#[test]
fn paths_are_taken_for_what_they_hold() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    assert_eq!(detect(root), None);
    assert_eq!(detect(&root.join("absent")), None);

    for name in ["a.MOV", "b.mp4", "c.txt", "d"] {
        fs::write(root.join(name), "").unwrap();
    }
    for (name, is_video) in [
        ("a.MOV", true),
        ("b.mp4", true),
        ("c.txt", false),
        ("d", false),
    ] {
        let path = root.join(name);
        let expected = is_video.then(|| Source::Video(path.clone()));
        assert_eq!(detect(&path), expected, "{name}");
    }
    assert_eq!(
        detect(root),
        None,
        "a folder of videos is no folder of photos"
    );

    let photos = root.join("photos");
    fs::create_dir_all(photos.join("images")).unwrap();
    assert_eq!(detect(&photos), None);
    image::RgbImage::new(8, 8)
        .save(photos.join("images/a.PNG"))
        .unwrap();
    assert_eq!(detect(&photos), Some(Source::Photos(photos.clone())));
    assert_eq!(detect(&photos).unwrap().path(), photos);
    fs::write(photos.join("transforms.json"), "{}").unwrap();
    assert_eq!(detect(&photos), None, "there are poses, if damaged ones");
}
