//! Decodes some views of a file, reading only the bytes that they need: `decode_views [FILE [VIEW ...]]`.

use std::error::Error;
use tsuya::container::Container;
use tsuya::decoder::{ViewSelection, decode_each};
use tsuya::{DecodeOptions, Limits};

/// A decoded view: its index and name, size in pixels, and mean radiance of the object, red green blue.
pub type ViewSummary = (usize, String, [usize; 2], [f64; 3]);

/// Decodes these views of a file; with them the number of bytes that were read, and that of the file.
pub fn run(file: &str, views: Vec<usize>) -> Result<(Vec<ViewSummary>, [u64; 2]), Box<dyn Error>> {
    let mut container = Container::open_path(file, Limits::default())?;
    let options = DecodeOptions { selection: ViewSelection::Views(views), ..Default::default() };
    let mut summaries = Vec::new();
    // Photographs come some at a time and in any order, so that memory does not grow with their number.
    decode_each(&mut container, &options, |asset, decoded| {
        for (index, photograph) in decoded {
            let mut sum = [0.0; 3];
            for image in &photograph.images {
                for pixel in &image.data {
                    (0..3).for_each(|c| sum[c] += f64::from(pixel[c]));
                }
            }
            let pixels = photograph.mask.count().max(1) as f64;
            let size = [photograph.mask.width, photograph.mask.height];
            summaries.push((index, asset.views[index].name.clone(), size, sum.map(|s| s / pixels)));
        }
        Ok(())
    })?;
    summaries.sort_by_key(|summary| summary.0);
    Ok((summaries, [container.bytes_read(), container.file_bytes()]))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/spec/vectors/ring-small.tsuya");
    let file = arguments.next().unwrap_or_else(|| sample.to_string());
    let views = arguments.map(|view| view.parse()).collect::<Result<Vec<usize>, _>>()?;
    let (summaries, [read, bytes]) = run(&file, if views.is_empty() { vec![0] } else { views })?;
    for (index, name, [width, height], [red, green, blue]) in summaries {
        println!("{index} {name}: {width} x {height}, mean radiance {red:.4} {green:.4} {blue:.4}");
    }
    println!("{read} of {bytes} bytes read");
    Ok(())
}
