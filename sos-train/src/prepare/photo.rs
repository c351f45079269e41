//! A photo's pixels: in memory, or in a file that the system pages in and out.
//!
//! A step looks at some hundred pixels of all photos, wherever they are. Photos that would fill the
//! memory lie in files without a name instead, mapped into the address space: what is looked at often
//! stays in the system's page cache, and what it has no room for is read again.

use image::{ImageBuffer, Rgb, RgbImage};
use memmap2::Mmap;
use std::fmt;
use std::io::Write as _;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use super::error::PrepareError;

/// Photos up to this many bytes in all are kept in memory.
const IN_MEMORY: u64 = 2 << 30;

/// A photo, 8-bit sRGB.
pub type Photo = ImageBuffer<Rgb<u8>, PhotoBytes>;

/// A photo's bytes, wherever they are. Clones of mapped ones share them.
#[derive(Clone)]
pub struct PhotoBytes(Place);

#[derive(Clone)]
enum Place {
    Memory(Vec<u8>),
    File(Arc<Mmap>),
}

impl PhotoBytes {
    /// How many of them take room in memory for good.
    #[must_use]
    pub fn in_memory(&self) -> usize {
        match &self.0 {
            Place::Memory(bytes) => bytes.len(),
            Place::File(_) => 0,
        }
    }
}

impl Deref for PhotoBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match &self.0 {
            Place::Memory(bytes) => bytes,
            Place::File(map) => map,
        }
    }
}

impl fmt::Debug for PhotoBytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = match &self.0 {
            Place::Memory(_) => "in memory",
            Place::File(_) => "in a file",
        };
        write!(f, "{} bytes {place}", self.len())
    }
}

/// A picture in memory as a photo.
#[must_use]
pub fn in_memory(picture: RgbImage) -> Photo {
    let (width, height) = picture.dimensions();
    with_bytes(width, height, Place::Memory(picture.into_raw()))
}

/// Of `3 * width * height` bytes.
fn with_bytes(width: u32, height: u32, place: Place) -> Photo {
    #[allow(clippy::expect_used)] // their number is that of the picture they are from
    Photo::from_raw(width, height, PhotoBytes(place)).expect("a byte for each channel")
}

/// Where a scene's photos are kept: the first of them in memory, the rest in files without a name.
#[derive(Debug)]
pub struct PhotoStore {
    folder: PathBuf,
    /// Bytes that memory still takes.
    room: AtomicU64,
}

impl PhotoStore {
    /// With files in `folder`, once there are 2 GiB in memory.
    #[must_use]
    pub fn new(folder: &Path) -> Self {
        Self::with_room(folder, IN_MEMORY)
    }

    /// With files in `folder`, once there are `room` bytes in memory.
    #[must_use]
    pub fn with_room(folder: &Path, room: u64) -> Self {
        Self {
            folder: folder.to_path_buf(),
            room: AtomicU64::new(room),
        }
    }

    /// Puts a photo where it is to be kept.
    ///
    /// # Errors
    /// [`PrepareError::Store`] when there is no room in the folder.
    pub fn keep(&self, photo: RgbImage) -> Result<Photo, PrepareError> {
        let bytes = photo.as_raw().len() as u64;
        let taken = |room: u64| room.checked_sub(bytes);
        if self.room.try_update(Relaxed, Relaxed, taken).is_ok() {
            return Ok(in_memory(photo));
        }
        let map = || -> std::io::Result<Mmap> {
            let mut file = tempfile::tempfile_in(&self.folder)?;
            // Written and not mapped first: a full disk is an error, not a signal.
            file.write_all(photo.as_raw())?;
            // SAFETY: the file has no name and is closed after this, so that nobody can open it to
            // shorten or change it.
            unsafe { Mmap::map(&file) }
        };
        let map = map().map_err(|source| PrepareError::Store {
            folder: self.folder.clone(),
            source,
        })?;
        let (width, height) = photo.dimensions();
        Ok(with_bytes(width, height, Place::File(Arc::new(map))))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_photo_in_a_file_is_the_photo() {
        let folder = tempfile::tempdir().unwrap();
        let picture = RgbImage::from_fn(7, 5, |x, y| Rgb([x as u8, y as u8, 200]));
        let photo = PhotoStore::with_room(folder.path(), 104).keep(picture.clone());
        let photo = photo.unwrap();
        let second = photo.clone();
        drop(photo);
        assert!(picture.pixels().eq(second.pixels()));
        assert_eq!(second.get_pixel(6, 4), picture.get_pixel(6, 4));
        assert_eq!(format!("{:?}", second.as_raw()), "105 bytes in a file");
        assert_eq!(second.as_raw().in_memory(), 0);
        // It leaves nothing to be tidied up.
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);

        let gone = PhotoStore::with_room(&folder.path().join("gone"), 0);
        let error = gone.keep(picture).unwrap_err().to_string();
        assert!(
            error.contains("gone") && error.contains("TMPDIR"),
            "{error}"
        );
    }

    #[test]
    fn memory_is_used_first() {
        let folder = tempfile::tempdir().unwrap();
        let store = PhotoStore::with_room(folder.path(), 250);
        let kept = [0; 3].map(|_| store.keep(RgbImage::new(7, 5)).unwrap());
        let kept = kept.map(|photo| photo.as_raw().in_memory());
        assert_eq!(kept, [105, 105, 0]);
    }
}
