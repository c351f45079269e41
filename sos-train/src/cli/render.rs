//! `sos render`: pictures and videos from where no photo was taken.

use super::RenderArgs;
use super::answer::Voice;
use super::resumed::explain;
use crate::doctor::room;
use crate::error::{EXIT_INTERRUPTED, EXIT_OK, InputError};
use crate::export::{byte, check_names};
use crate::progress::{AtInterrupt, Progress, watch_interrupt};
use crate::render::frame::{Frame, draw_object, draw_scene};
use crate::render::path::{NovelCamera, along_the_photos, of_model, size_like_photos, turntable};
use crate::render::rays::FrozenScene;
use crate::render::trained::load_trained;
use crate::run_folder::RunFolder;
use glam::Vec3;
use io_colmap::{Model, Scene};
use scene_export::{Codec, Draft, Existing, ExportError, Ffmpeg, Kind, Picture, Video};
use serde_json::json;
use std::path::Path;
use std::sync::atomic::Ordering;

/// What the object of a turntable stands before in videos without alpha.
const PAPER: Vec3 = Vec3::splat(0.92);

/// Pixels along a side of a picture, at most.
const LONGEST_SIDE: u32 = 1 << 15;
/// Bytes of a pixel of a [`Frame`] with the whole scene.
const FRAME_BYTES: u64 = 40;

/// Renders a turntable, a way along the photos, or what given cameras see.
///
/// The exit code tells whether it was stopped: then nothing is kept.
pub(super) fn render(args: &RenderArgs) -> anyhow::Result<u8> {
    let run = RunFolder::open_existing(&args.run)?;
    let name = match (&args.views, args.turntable) {
        (Some(_), _) => "views",
        (None, Some(_)) => "turntable",
        (None, None) => "path",
    };
    let out = match &args.out {
        Some(out) => out.clone(),
        None => run.root().join("render").join(name),
    };
    let existing = if args.force {
        Existing::Replace
    } else {
        Existing::Keep
    };
    let draft = Draft::begin(&out, existing)?;
    let screen = Progress::new(args.quiet, 0);
    // Without a handler, Ctrl-C ends the program and leaves what it was writing.
    let interrupt = watch_interrupt(AtInterrupt::LeaveNothing).unwrap_or_default();
    // Read first: what cannot be read should not be found out after the photos.
    let model = match &args.views {
        Some(folder) => {
            let model = Scene::read_model(folder)?;
            check_names(folder, model.views.iter().map(|view| view.name.as_str()))?;
            if model.views.is_empty() {
                let remedy = "give one with the views that are to be drawn";
                return Err(InputError::new(folder, "the model has no views", remedy).into());
            }
            check_sizes(folder, &model)?;
            Some(model)
        }
        None => None,
    };
    let (scene, data) = load_trained(&run).map_err(|error| explain(&run, error))?;
    let like_photos = size_like_photos(&data, args.size);
    let cameras = match (model, args.turntable, args.path) {
        (Some(model), ..) => of_model(&data, &model)?,
        (None, Some(count), _) => turntable(&data, count, like_photos),
        (None, None, count) => along_the_photos(&data, count.unwrap_or(1), like_photos),
    };
    let count = cameras.len();
    // A video has frames of one size; pictures from a list of cameras make none.
    let filmed = args.views.is_none();
    let mut sequences = if args.turntable.is_some() {
        vec![
            Sequence::new("object", Kind::Rgba, Codec::WebmAlpha, "webm", cut_out),
            Sequence::new("paper", Kind::Rgb, Codec::Mp4Colour, "mp4", on_paper),
        ]
    } else {
        vec![
            Sequence::new("scene", Kind::Rgb, Codec::Mp4Colour, "mp4", |f| {
                colours(&f.scene)
            }),
            Sequence::new("object", Kind::Rgba, Codec::WebmAlpha, "webm", cut_out),
            Sequence::new("background", Kind::Rgb, Codec::Mp4Colour, "mp4", |f| {
                colours(&f.background)
            }),
        ]
    };
    let mut notes = vec![if filmed {
        format!(
            "{count} frames of {}x{}, sRGB, straight alpha; step {} of the run",
            like_photos.0, like_photos.1, scene.step
        )
    } else {
        format!(
            "{count} views, sRGB, straight alpha; step {} of the run",
            scene.step
        )
    }];
    match Ffmpeg::find() {
        _ if !filmed => {}
        Ok(ffmpeg) => {
            for sequence in &mut sequences {
                sequence.begin_video(&ffmpeg, &draft, like_photos, args.fps, &mut notes)?;
            }
        }
        Err(error) => notes.push(format!("frames only, no videos: {error}")),
    }
    let stage = screen.stage("drawing", cameras.len());
    for camera in &cameras {
        if interrupt.load(Ordering::SeqCst) {
            return Ok(EXIT_INTERRUPTED);
        }
        let frame = draw(&scene, camera, args);
        for sequence in &mut sequences {
            sequence.add(camera, &frame, &draft)?;
        }
        stage.advance();
    }
    drop(stage);
    for video in sequences.into_iter().filter_map(|sequence| sequence.video) {
        video.finish()?;
    }
    for note in &notes {
        screen.note(note);
    }
    let record = format!(
        "{name}, rendered by sos {} from {}\n- {}\n",
        env!("CARGO_PKG_VERSION"),
        run.root().display(),
        notes.join("\n- ")
    );
    draft.finish(&record)?;
    let result = json!({ "folder": out, "frames": count, "notes": notes });
    let sentence = format!("{}: {count} frames", out.display());
    Voice::of(args.json, args.quiet).answer(&result, &sentence)?;
    Ok(EXIT_OK)
}

/// Refuses views that no memory holds.
fn check_sizes(folder: &Path, model: &Model) -> Result<(), InputError> {
    let memory = room::of_machine().unwrap_or(u64::MAX);
    for view in &model.views {
        let Some(camera) = model.cameras.get(&view.camera_id) else {
            continue;
        };
        let (width, height) = (camera.width, camera.height);
        let bytes = FRAME_BYTES * u64::from(width) * u64::from(height);
        if width.max(height) > LONGEST_SIDE || bytes > memory {
            let remedy = format!(
                "give its camera a size of at most {LONGEST_SIDE} pixels a side that has room in memory, at {FRAME_BYTES} bytes a pixel"
            );
            let what = format!(
                "the view {:?} is {width}x{height}, too large to be drawn",
                view.name
            );
            return Err(InputError::new(folder, what, remedy));
        }
    }
    Ok(())
}

fn draw(scene: &FrozenScene, camera: &NovelCamera, args: &RenderArgs) -> Frame {
    match args.turntable {
        Some(_) => draw_object(scene, camera),
        None => draw_scene(scene, camera),
    }
}

/// One kind of picture of every frame: a folder of PNG files, and a video where there is ffmpeg.
struct Sequence {
    name: &'static str,
    kind: Kind,
    codec: Codec,
    ending: &'static str,
    bytes: fn(&Frame) -> Vec<u8>,
    video: Option<Video>,
}

impl Sequence {
    fn new(
        name: &'static str,
        kind: Kind,
        codec: Codec,
        ending: &'static str,
        bytes: fn(&Frame) -> Vec<u8>,
    ) -> Self {
        Self {
            name,
            kind,
            codec,
            ending,
            bytes,
            video: None,
        }
    }

    fn begin_video(
        &mut self,
        ffmpeg: &Ffmpeg,
        draft: &Draft,
        size: (u32, u32),
        rate: u32,
        notes: &mut Vec<String>,
    ) -> Result<(), ExportError> {
        let name = format!("{}.{}", self.name, self.ending);
        if ffmpeg.can(self.codec) {
            let path = draft.place(&name)?;
            self.video = Some(ffmpeg.begin(&path, size, rate, self.codec)?);
        } else {
            notes.push(format!("no {name}: this ffmpeg has no encoder for it"));
        }
        Ok(())
    }

    fn add(
        &mut self,
        camera: &NovelCamera,
        frame: &Frame,
        draft: &Draft,
    ) -> Result<(), ExportError> {
        let bytes = (self.bytes)(frame);
        if let Some(video) = &mut self.video {
            video.push(&bytes)?;
        }
        Picture {
            width: camera.width,
            height: camera.height,
            kind: self.kind,
            remark: "rendered from where no photo was taken; alpha, if any, is straight",
            bytes: &bytes,
        }
        .write(draft, &format!("{}/{}.png", self.name, camera.name))
    }
}

fn colours(pixels: &[Vec3]) -> Vec<u8> {
    pixels.iter().flat_map(|c| c.to_array().map(byte)).collect()
}

fn cut_out(frame: &Frame) -> Vec<u8> {
    let pixels = frame.object.iter().zip(&frame.alpha);
    pixels
        .flat_map(|(c, alpha)| [c.x, c.y, c.z, *alpha].map(byte))
        .collect()
}

fn on_paper(frame: &Frame) -> Vec<u8> {
    let pixels = frame.object.iter().zip(&frame.alpha);
    let over: Vec<Vec3> = pixels.map(|(c, alpha)| PAPER.lerp(*c, *alpha)).collect();
    colours(&over)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use io_colmap::{Camera, CameraModel, Pose, View};

    #[test]
    fn views_that_no_memory_holds_are_named() {
        let sized = |width: u32, height: u32| Model {
            cameras: [(
                1,
                Camera {
                    id: 1,
                    model: CameraModel::SimplePinhole,
                    width,
                    height,
                    params: vec![100.0, 50.0, 50.0],
                },
            )]
            .into(),
            views: vec![View {
                id: 1,
                camera_id: 1,
                name: "vast.png".to_owned(),
                camera_from_world: Pose::IDENTITY,
            }],
            points: Vec::new(),
        };
        let folder = Path::new("scene");
        check_sizes(folder, &sized(1920, 1080)).unwrap();
        for model in [sized(1 << 20, 1 << 20), sized(1, LONGEST_SIDE + 1)] {
            let says = check_sizes(folder, &model).unwrap_err().to_string();
            assert!(
                says.starts_with("scene: the view \"vast.png\"") && says.contains("32768"),
                "{says}"
            );
        }
    }
}
