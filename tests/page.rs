//! `report.html` in a real browser: what is clicked does what it says, and no number is from elsewhere.

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use common::Folder;
use serde_json::Value;

/// A headless browser, if there is one.
fn browser() -> Option<PathBuf> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH")?).collect();
    folders.iter().flat_map(|folder| names.map(|name| folder.join(name))).find(|path| path.is_file())
}

/// What `script`, a function body, returns when it is run in the page `html` that is `width` pixels wide. `None`, said
/// aloud, where there is no browser.
fn in_browser(folder: &Folder, html: &Path, width: u32, script: &str) -> Option<Value> {
    let Some(browser) = browser() else {
        eprintln!("SKIPPED: there is no Chromium here; `apt-get install chromium` brings it");
        return None;
    };
    let text = std::fs::read_to_string(html).expect("the page was written");
    let probe = format!(
        "<pre id=\"found\"></pre><script>addEventListener('load', async () => {{ \
            let found; try {{ found = await (async () => {{ {script} }})(); }} catch (error) {{ found = {{error: String(error)}}; }} \
            document.getElementById('found').textContent = 'FOUND' + btoa(unescape(encodeURIComponent(JSON.stringify(found)))) + 'END'; }});</script></body>"
    );
    assert!(text.contains("</body>"));
    let page = folder.write("probe.html", &text.replacen("</body>", &probe, 1));
    let output = Command::new(browser)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--virtual-time-budget=20000",
        ])
        .arg(format!("--window-size={width},900"))
        .arg(format!("--user-data-dir={}", folder.path("profile").display()))
        .args(["--dump-dom", &format!("file://{}", page.display())])
        .output()
        .expect("the browser starts");
    let dom = String::from_utf8_lossy(&output.stdout).into_owned();
    let mark = "<pre id=\"found\">FOUND";
    let start = dom.find(mark).map(|at| at + mark.len());
    let start = start
        .unwrap_or_else(|| panic!("the page ran no script: {}", String::from_utf8_lossy(&output.stderr)));
    let end = start + dom[start..].find("END").expect("its end");
    let found: Value = serde_json::from_slice(&decoded(&dom[start..end])).expect("JSON");
    assert_eq!(found["error"], Value::Null, "{found}");
    Some(found)
}

/// Base 64 as `btoa` writes it.
fn decoded(text: &str) -> Vec<u8> {
    let value = |byte: u8| match byte {
        b'A'..=b'Z' => byte - b'A',
        b'a'..=b'z' => byte - b'a' + 26,
        b'0'..=b'9' => byte - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let sextets: Vec<u8> = text.bytes().filter(|byte| *byte != b'=').map(value).collect();
    let mut bytes = Vec::new();
    for group in sextets.chunks(4) {
        let word =
            group.iter().enumerate().fold(0_u32, |word, (i, six)| word | u32::from(*six) << (18 - 6 * i));
        bytes.extend((0..group.len().saturating_sub(1)).map(|i| (word >> (16 - 8 * i)) as u8));
    }
    bytes
}

/// The page of a run of `tiny` on a machine that differs from the shipped one.
fn page_of_run(folder: &Folder) -> PathBuf {
    folder.run(&["run", "tiny", "--set", "cores=6", "-o", "run"]).ok();
    folder.run(&["report", "run"]).ok();
    folder.path("run/report.html")
}

#[test]
fn clicks_sort_zoom_and_switch_the_theme() {
    let folder = Folder::new();
    let html = page_of_run(&folder);
    let script = r#"
        const column = (table, index) => [...table.querySelectorAll("tbody tr:not(.total)")].map((row) => Number(row.children[index].textContent));
        const table = document.querySelector("table"), head = table.querySelectorAll("th")[1];
        const before = column(table, 1);
        head.querySelector("button").click();
        const once = column(table, 1), first = head.getAttribute("aria-sort");
        head.querySelector("button").click();
        const twice = column(table, 1), second = head.getAttribute("aria-sort");
        const image = document.querySelector(".picture img");
        await image.decode();
        const hidden = image.parentNode.scrollHeight - image.parentNode.clientHeight;
        const widths = [...document.querySelectorAll(".zoom button")].map((button) => { button.click(); return image.getBoundingClientRect().width; });
        const root = document.documentElement, theme = () => [root.dataset.theme, getComputedStyle(document.body).backgroundColor];
        const themes = [theme()];
        document.getElementById("theme").click();
        themes.push(theme());
        document.getElementById("theme").click();
        themes.push(theme());
        return { before, once, twice, first, second, widths, hidden, natural: image.naturalWidth, themes, differs: document.querySelectorAll("tr.differs").length };
    "#;
    let Some(found) = in_browser(&folder, &html, 1280, script) else { return };
    let numbers = |name: &str| -> Vec<f64> {
        found[name].as_array().expect("a list").iter().map(|n| n.as_f64().expect("a number")).collect()
    };
    let (mut sorted, before) = (numbers("before"), numbers("before"));
    sorted.sort_by(|a, b| b.total_cmp(a));
    assert_ne!(before, sorted, "the table is in program order first");
    assert_eq!((numbers("once"), &found["first"]), (sorted.clone(), &Value::from("descending")));
    sorted.reverse();
    assert_eq!((numbers("twice"), &found["second"]), (sorted, &Value::from("ascending")));

    let natural = found["natural"].as_f64().expect("a width");
    assert!(numbers("widths")[0] > 4.0 * natural, "a small picture fills its frame: {:?}", found["widths"]);
    assert_eq!(found["hidden"], 0, "all of a fitted picture is seen");
    let zoomed: Vec<f64> = numbers("widths")[1..].iter().map(|width| width / natural).collect();
    assert_eq!(zoomed, [1.0, 2.0, 4.0, 8.0]);

    let themes = found["themes"].as_array().expect("a list");
    assert_eq!(themes[0], themes[2]);
    assert!(themes[0][0] != themes[1][0] && themes[0][1] != themes[1][1], "{themes:?}");
    assert!(found["differs"].as_u64().expect("a count") >= 1, "the number of cores differs from the preset");
}

#[test]
fn every_number_is_from_the_json() {
    let folder = Folder::new();
    let html = page_of_run(&folder);
    // Numbers and words of the JSON as the page writes them; sums over phases; IPC and megabytes in their own form.
    let script = r#"
        const known = new Set(["-"]), add = (number) => known.add(short(number)).add(String(number));
        (function walk(value) { if (typeof value === "number") add(value); else if (typeof value === "string") known.add(value); else if (value && typeof value === "object") Object.values(value).forEach(walk); })(data);
        const phases = data.report.phases, sum = (pick) => add(phases.reduce((all, phase) => all + pick(phase), 0));
        for (const group of ["l1d", "l2", "ring", "directory", "memory", "atomics"]) for (const name of Object.keys(phases[0][group])) sum((phase) => phase[group][name]);
        sum((phase) => phase.instructions.total); sum((phase) => (phase.in_paper_total ? phase.instructions.total : 0));
        for (const phase of phases) known.add(phase.ipc.toFixed(3)).add((phase.memory.bytes / 1e6).toFixed(2));
        known.add((phases.reduce((all, phase) => all + phase.memory.bytes, 0) / 1e6).toFixed(2));
        const shown = [...document.querySelectorAll("td, .figures b")].map((cell) => cell.textContent.trim());
        const numbers = shown.filter((text) => /^[-+0-9.e\u202f]+$/.test(text));
        return { count: numbers.length, foreign: numbers.filter((text) => !known.has(text)) };
    "#;
    let Some(found) = in_browser(&folder, &html, 1280, script) else { return };
    assert_eq!(found["foreign"], serde_json::json!([]));
    assert!(found["count"].as_u64().expect("a count") > 200, "{found}");
}

#[test]
fn picture_truth_and_difference_lie_under_one_slider() {
    let folder = Folder::new();
    folder.run(&["run", "tiny", "--fidelity", "functional", "--reference", "16", "-o", "run"]).ok();
    folder.run(&["report", "run"]).ok();
    let html = folder.path("run/report.html");
    let script = r#"
        const frame = document.querySelector(".wipe"), stack = frame.querySelector(".layers"), slider = document.querySelector(".ends input");
        const over = stack.querySelector(".over"), under = stack.querySelector(".under");
        const state = () => [over.alt, under.alt, getComputedStyle(over).clipPath, slider.value];
        const box = stack.getBoundingClientRect(), places = [over, under].map((image) => { const place = image.getBoundingClientRect(); return [place.left, place.top, place.width, place.height]; });
        const states = [state()];
        // Keys and a drag of the slider are the browser's own, and end in this event.
        slider.value = 20; slider.dispatchEvent(new Event("input")); states.push(state());
        const point = (type, part, kind) => over.dispatchEvent(new PointerEvent(type, { bubbles: true, isPrimary: true, buttons: 1, pointerType: kind, clientX: box.left + part * box.width, clientY: box.top + 5 }));
        point("pointerdown", 0.7, "mouse"); states.push(state());
        point("pointermove", 0.25, "touch"); states.push(state());
        const tabs = [...document.querySelectorAll("button")].filter((button) => button.textContent.includes(" | "));
        tabs[2].click(); states.push(state());
        slider.focus();
        return { states, places, focus: document.activeElement === slider, kind: slider.type, label: slider.getAttribute("aria-label"), said: slider.getAttribute("aria-valuetext"), touch: getComputedStyle(stack).touchAction,
            shows: under.src === data.judged.difference.url, scale: document.querySelector(".scale div").style.background.includes("gradient"), measures: [...document.querySelectorAll("td")].filter((cell) => cell.textContent === "rmse").length };
    "#;
    let Some(found) = in_browser(&folder, &html, 1280, script) else { return };
    let states = serde_json::json!([
        ["ours", "truth", "inset(0px 50% 0px 0px)", "50"],
        ["ours", "truth", "inset(0px 80% 0px 0px)", "20"],
        ["ours", "truth", "inset(0px 30% 0px 0px)", "70"],
        ["ours", "truth", "inset(0px 75% 0px 0px)", "25"],
        ["truth", "difference", "inset(0px 75% 0px 0px)", "25"],
    ]);
    let shown =
        found["states"].to_string().replace("calc(100% - 50%)", "50%").replace("calc(100% - 20%)", "80%");
    let shown = shown.replace("calc(100% - 70%)", "30%").replace("calc(100% - 25%)", "75%");
    assert_eq!(serde_json::from_str::<Value>(&shown).expect("JSON"), states);
    assert_eq!(found["places"][0], found["places"][1], "one picture lies on the other");
    assert_eq!(
        (&found["kind"], &found["focus"]),
        (&Value::from("range"), &Value::from(true)),
        "keys move it"
    );
    assert_eq!(found["said"], "25 % truth, the rest difference");
    assert_eq!((&found["touch"], &found["scale"]), (&Value::from("pan-y"), &Value::from(true)));
    assert_eq!(found["shows"], true, "the difference is the one of the run");
    assert_eq!(found["measures"], 1);
}

#[test]
fn a_page_fits_a_narrow_window() {
    let folder = Folder::new();
    let run = page_of_run(&folder);
    folder.write(
        "small.json",
        r#"{"name": "small", "base": {"scene": "tiny"}, "axes": [{"path": "cores", "values": [1, 2, 4]}], "analysis": ["speedup", "power_law"]}"#,
    );
    folder.run(&["study", "small.json", "-o", "study"]).ok();
    folder.run(&["run", "saloon-orbit", "--frames", "2", "--size", "64x48", "-o", "moving"]).ok();
    folder.run(&["run", "tiny", "--fidelity", "functional", "--reference", "4", "-o", "untimed"]).ok();
    folder.run(&["report", "untimed"]).ok();
    let script = "document.querySelectorAll('details').forEach((part) => { part.open = true; }); return { page: document.documentElement.scrollWidth, window: innerWidth, sections: document.querySelectorAll('section').length, \
        wide: [...document.querySelectorAll('.scroll')].filter((part) => part.scrollWidth > part.clientWidth).map((part) => part.innerText.slice(0, 80)), \
        trust: document.body.innerText.includes('How far to trust it') };";
    let untimed = folder.path("untimed/report.html");
    for html in [&run, &folder.path("study/report.html"), &folder.path("moving/report.html"), &untimed] {
        for width in [500, 1280] {
            let Some(found) = in_browser(&folder, html, width, script) else { return };
            assert_eq!(found["trust"], *html != untimed, "how far times can be trusted, where there are any");
            if width == 1280 {
                assert_eq!(found["wide"], serde_json::json!([]), "{}", html.display());
            }
            assert!(found["page"].as_u64() <= found["window"].as_u64(), "{} {found}", html.display());
            assert!(found["sections"].as_u64().expect("a count") > 5, "{found}");
        }
    }
}

#[test]
fn pages_of_estimates_say_so_and_show_limits_in_place_of_cycles() {
    let folder = Folder::new();
    folder.run(&["run", "tiny", "--fidelity", "roofline", "-o", "run"]).ok();
    folder.run(&["report", "run"]).ok();
    folder.run(&["study", "fidelity", "--quick", "--only", "tiny", "-o", "prices"]).ok();
    let script = "return { heads: [...document.querySelectorAll('h2')].map((head) => head.textContent), text: document.body.innerText };";
    for (page, heads, absent, said) in [
        (
            "run/report.html",
            &["What limits the phases", "Roofline"][..],
            "Where the cycles went",
            "times are estimates from what limits each step",
        ),
        ("prices/report.html", &["The price list", "tiny"], "Phases", "windowed is the default"),
    ] {
        let Some(found) = in_browser(&folder, &folder.path(page), 1000, script) else { return };
        let shown: Vec<&str> =
            found["heads"].as_array().expect("a list").iter().filter_map(Value::as_str).collect();
        assert!(
            heads.iter().all(|head| shown.contains(head)) && !shown.contains(&absent),
            "{page}: {shown:?}"
        );
        assert!(found["text"].as_str().is_some_and(|text| text.contains(said)), "{page}");
    }
}
