//! Any bytes as a photograph, as a picture of an environment, and as a video of YUV4MPEG2.

use std::path::Path;
use tsuya::ar::{Y4mFrame, Y4mReader, Y4mWriter};
use tsuya::image::read_radiance;
use tsuya::lighting::{EnvironmentReadOptions, read_environment};
use tsuya_fuzz::folder;

pub fn fuzz(bytes: &[u8]) {
    if bytes.starts_with(b"YUV4MPEG2") {
        return video(bytes);
    }
    let path = folder::file("photograph", bytes);
    if let Ok(picture) = read_radiance(&path, &folder::access()) {
        assert_eq!(picture.data.len(), picture.width * picture.height);
        let missing = |pixel: &[f32; 3]| pixel.iter().all(|x| x.is_nan()) || pixel.iter().all(|x| x.is_finite());
        assert!(picture.data.iter().all(missing));
        if picture.data.len() <= 4096
            && let Ok((environment, _)) = read_environment(
                &[&path],
                &EnvironmentReadOptions { width: Some(16), limits: folder::limits(), ..Default::default() },
            )
        {
            assert!(environment.image().data.as_flattened().iter().all(|x| x.is_finite() && *x >= 0.0));
        }
    }
}

/// Frames come back as they were, and with what is changed in them.
fn video(bytes: &[u8]) {
    let path = Path::new("-");
    let Ok(mut reader) = Y4mReader::new(bytes, path, &folder::access()) else { return };
    let header = reader.header().clone();
    let mut writer = Y4mWriter::new(Vec::new(), path, &header).expect("memory takes everything");
    let mut frame = Y4mFrame::default();
    let mut frames = 0;
    while frames < 3 && reader.read_frame(&mut frame).is_ok_and(|more| more) {
        let image = frame.to_image(&header).expect("a frame of its size");
        let same = frame.clone();
        frame.update(&header, &image, &image).expect("an image of its size");
        assert!(frame == same);
        let inverted = image.map(|pixel| pixel.map(|code| 255 - code));
        frame.update(&header, &image, &inverted).expect("an image of its size");
        writer.write_frame(&frame).expect("memory takes everything");
        frames += 1;
    }
    let written = writer.finish().expect("memory takes everything");
    let mut again = Y4mReader::new(&written[..], path, &folder::access()).expect("our own header");
    assert_eq!(again.header(), &header);
    for _ in 0..frames {
        assert!(again.read_frame(&mut frame).expect("our own frame"));
    }
    assert!(!again.read_frame(&mut frame).expect("the end"));
}
