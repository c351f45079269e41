//! Videos, looked at with ffprobe and decoded with ffmpeg, where they are installed.

use crate::rig::{HEIGHT, PHOTOS, Rig, WIDTH, alpha, plate_colour};
use scene_export::{Ffmpeg, Target};
use std::path::Path;
use std::process::Command;

/// A program's standard output; `None`, with the reason printed, where it is not installed.
fn output(program: &str, arguments: &[&str], file: &Path) -> Option<Vec<u8>> {
    let mut command = Command::new(program);
    for argument in arguments {
        match *argument {
            "FILE" => command.arg(file),
            other => command.arg(other),
        };
    }
    match command.output() {
        Ok(output) => {
            let complaint = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{complaint}");
            Some(output.stdout)
        }
        Err(error) => {
            println!("skipped: {program} does not start ({error})");
            None
        }
    }
}

#[test]
fn videos_hold_every_view() {
    if let Err(error) = Ffmpeg::find() {
        println!("skipped: {error}");
        return;
    }
    let rig = Rig::new();
    let (out, written) = rig.files(Target::Video);
    assert_eq!(written.count, PHOTOS.len());
    let probe = "v:0";
    for (name, codec, pixels) in [
        ("alpha.mp4", "h264", "yuv420p"),
        ("background.mp4", "h264", "yuv420p"),
        ("foreground.mov", "prores", "yuva444p12le"),
        // ffprobe's own decoder knows nothing of VP9's alpha; the tag says that it is there.
        ("foreground.webm", "vp9", "yuv420p"),
    ] {
        let missing = written.notes.iter().any(|note| note.contains(name));
        if missing {
            println!("skipped: {:?}", written.notes);
            continue;
        }
        let arguments = [
            "-v",
            "error",
            "-select_streams",
            probe,
            "-count_frames",
            "-show_entries",
            "stream=codec_name,width,height,pix_fmt,r_frame_rate,nb_read_frames:stream_tags=alpha_mode",
            "-of",
            "default=noprint_wrappers=1",
            "FILE",
        ];
        let Some(said) = output("ffprobe", &arguments, &out.join(name)) else {
            return;
        };
        let said = String::from_utf8(said).unwrap();
        let says = |line: String| assert!(said.contains(&line), "{line} is not in {said}");
        if codec != "h264" || said.contains("h264") {
            says(format!("codec_name={codec}"));
        }
        says(format!("width={WIDTH}"));
        says(format!("height={HEIGHT}"));
        says(format!("nb_read_frames={}", PHOTOS.len()));
        says("r_frame_rate=12/1".to_owned());
        if codec == "prores" {
            // How many bits an ffmpeg decodes ProRes to has changed.
            says("pix_fmt=yuva444p1".to_owned());
        } else {
            says(format!("pix_fmt={pixels}"));
        }
        if codec == "vp9" {
            says("alpha_mode=1".to_owned());
        }
    }
}

#[test]
fn videos_show_what_the_pictures_show() {
    if let Err(error) = Ffmpeg::find() {
        println!("skipped: {error}");
        return;
    }
    let rig = Rig::new();
    let (out, _) = rig.files(Target::Video);
    let frames = |name: &str, pixels: &str| {
        let arguments = [
            "-v", "error", "-i", "FILE", "-f", "rawvideo", "-pix_fmt", pixels, "-",
        ];
        output("ffmpeg", &arguments, &out.join(name)).unwrap()
    };
    let size = (WIDTH * HEIGHT) as usize;
    let mattes = frames("alpha.mp4", "gray");
    assert_eq!(mattes.len(), PHOTOS.len() * size);
    let plates = frames("background.mp4", "rgb24");
    let cutouts = frames("foreground.mov", "rgba");
    let (mut worst, mut alphas) = (0, 0);
    for (photo, matte) in mattes.chunks_exact(size).enumerate() {
        let error: i64 = matte
            .iter()
            .zip(0..)
            .map(|(value, i)| {
                let wanted = i64::from(alpha(photo, i % WIDTH, i / WIDTH) / 257);
                (i64::from(*value) - wanted).abs()
            })
            .sum();
        worst = worst.max(error / size as i64);
        let cutout = &cutouts[photo * 4 * size..];
        let error: i64 = (0..size)
            .map(|i| {
                let (x, y) = (i as u32 % WIDTH, i as u32 / WIDTH);
                let wanted = i64::from(alpha(photo, x, y) / 257);
                (i64::from(cutout[4 * i + 3]) - wanted).abs()
            })
            .sum();
        alphas = alphas.max(error / size as i64);
    }
    assert!(
        worst <= 3,
        "the mattes are off by {worst} of 255 on average"
    );
    assert!(alphas <= 1, "alpha of the cut-outs is off by {alphas}");
    let middle = ((HEIGHT / 2) * WIDTH + 20) as usize;
    for (seen, wanted) in plates[3 * middle..].iter().zip(plate_colour(20)) {
        assert!(seen.abs_diff(wanted) < 12, "{seen} {wanted}");
    }
}
