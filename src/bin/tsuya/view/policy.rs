//! What a browser may do with what it is served: Content-Security-Policy and its kin.

use super::site::Site;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use hyper::header::{self, HeaderName, HeaderValue};
use sha2::{Digest, Sha256};

/// Header fields of every answer.
pub const ENCLOSURE: [(HeaderName, &str); 5] = [
    // The file may be another one at the next call.
    (header::CACHE_CONTROL, "no-store"),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    // Other sites can't have what is shown as a picture or a script of theirs.
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
];

/// Content-Security-Policy of what is not the page's own: nothing of it is ever run, whatever it is.
pub const OF_DATA: HeaderValue = HeaderValue::from_static("default-src 'none'; frame-ancestors 'none'; sandbox");

/// Content-Security-Policy of the page's own files: they and what they show come from this server alone, so that an object with addresses in it
/// tells nobody that it is looked at. WebAssembly is compiled; textures are made of pictures within a file (`blob:`, `data:`); of the scripts that
/// stand in a page (its import map) those that are there when the server begins are allowed, by their digests.
pub fn of_page(site: &Site) -> HeaderValue {
    let pages = site.files().filter(|(path, _)| site.is_page(path) && path.ends_with(".html"));
    let digests: String = pages
        .filter_map(|(_, content)| content.read().ok())
        .flat_map(|bytes| inline_scripts(&String::from_utf8_lossy(&bytes)).map(digest).collect::<Vec<_>>())
        .collect();
    let policy = format!(
        "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'{digests}; worker-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
         connect-src 'self' blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    );
    HeaderValue::try_from(policy).unwrap_or(OF_DATA)
}

fn digest(script: &str) -> String {
    format!(" 'sha256-{}'", BASE64_STANDARD.encode(Sha256::digest(script)))
}

/// What stands between the tags of the scripts of a page, without those that are files of their own.
fn inline_scripts(page: &str) -> impl Iterator<Item = &str> {
    page.split("<script").skip(1).filter_map(|rest| {
        let (attributes, rest) = rest.split_once('>')?;
        let (script, _) = rest.split_once("</script")?;
        (!attributes.contains("src=")).then_some(script)
    })
}

#[cfg(test)]
mod tests {
    use super::{digest, inline_scripts};

    #[test]
    fn scripts_within_a_page_are_found() {
        let page = "<script src=\"a.js\"></script><script type=\"importmap\">{\"imports\": {}}</script>\n<script>b()</script><script>";
        assert_eq!(inline_scripts(page).collect::<Vec<_>>(), ["{\"imports\": {}}", "b()"]);
        // The example of the W3C's Content Security Policy Level 3, section 8.4 (https://www.w3.org/TR/CSP3/).
        assert_eq!(digest("alert('Hello, world.');"), " 'sha256-qznLcsROx4GACP2dm0UCKCzCG+HiZ1guq6ZZDob/Tng='");
    }
}
