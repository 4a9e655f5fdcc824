//! Which files of a crate use which: an edge leads from a file to each file that defines an item it
//! names, in `use` declarations and in paths. Re-exports are followed to the definition and are no
//! edges, nor are `mod` lines, nor tests. Methods are not followed: their names have no path.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs;
use std::path::{Component, Path, PathBuf};

use super::tokens::{self, Kind, Token};

/// Edges between files: by file and used file, the names that are used.
pub(crate) type Edges = BTreeMap<PathBuf, BTreeMap<PathBuf, BTreeSet<String>>>;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Target {
    Module(usize),
    /// An item, by the module that defines it.
    Item(usize),
}

/// A `use` of one name, or of all names if `name` is `*`.
struct Import {
    name: String,
    path: Vec<String>,
    is_export: bool,
}

#[derive(Default)]
struct Module {
    file: PathBuf,
    parent: usize,
    children: BTreeMap<String, usize>,
    items: BTreeSet<String>,
    imports: Vec<Import>,
    /// Paths in the code, `use` declarations excluded.
    paths: Vec<Vec<String>>,
}

/// Reads the crate whose root file is given and returns its edges.
pub(crate) fn edges(root: &Path) -> Edges {
    let mut modules = Modules(vec![Module { file: root.to_owned(), ..Module::default() }]);
    modules.read_file(0, root.parent().unwrap());
    modules.edges()
}

struct Modules(Vec<Module>);

impl Modules {
    /// Reads a module's file; `folder` holds the files of its children.
    fn read_file(&mut self, module: usize, folder: &Path) {
        let file = &self.0[module].file;
        let text = fs::read_to_string(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let tokens = tokens::without_tests(&tokens::tokens(&text));
        self.read_items(module, &tokens, folder);
    }

    /// Reads the items of a module, and of the modules in it.
    fn read_items(&mut self, module: usize, tokens: &[Token<'_>], folder: &Path) {
        let (mut at, mut is_export, mut other_path) = (0, false, None);
        while let Some(token) = tokens.get(at) {
            let next = tokens.get(at + 1).map_or("", |t| t.text);
            match token.text {
                "#" => {
                    let open = at + 1 + usize::from(next == "!");
                    let end = tokens::group_end(tokens, open);
                    if tokens[open + 1].text == "path" {
                        other_path = Some(tokens[open + 3].text.trim_matches('"').to_owned());
                    }
                    self.read_code(module, &tokens[at..end]);
                    at = end;
                    continue;
                }
                "pub" => {
                    is_export = true;
                    at = if next == "(" { tokens::group_end(tokens, at + 1) } else { at + 1 };
                    continue;
                }
                "use" => {
                    let end = at + tokens[at..].iter().position(|t| t.text == ";").unwrap();
                    self.read_import(module, &tokens[at + 1..end], &[], is_export);
                    at = end + 1;
                }
                "mod" => {
                    let name = next.to_owned();
                    let has_path = other_path.is_some();
                    let file = match other_path.take() {
                        Some(path) => self.0[module].file.with_file_name(path),
                        None => Some(folder.join(format!("{name}.rs")))
                            .filter(|file| file.is_file())
                            .unwrap_or_else(|| folder.join(&name).join("mod.rs")),
                    };
                    // The children of a file with a path attribute are in its own folder.
                    let inner = if has_path { file.parent().unwrap().to_owned() } else { folder.join(&name) };
                    let child = self.0.len();
                    self.0[module].children.insert(name, child);
                    let own = self.0[module].file.clone();
                    self.0.push(Module { parent: module, ..Module::default() });
                    if tokens[at + 2].text == "{" {
                        self.0[child].file = own;
                        let end = tokens::group_end(tokens, at + 2);
                        self.read_items(child, &tokens[at + 3..end - 1], &inner);
                        at = end;
                    } else {
                        self.0[child].file = file;
                        self.read_file(child, &inner);
                        at += 3;
                    }
                }
                _ => {
                    let end = item_or_statement_end(tokens, at);
                    self.0[module].items.extend(defined(&tokens[at..end]));
                    self.read_code(module, &tokens[at..end]);
                    at = end;
                }
            }
            (is_export, other_path) = (false, None);
        }
    }

    /// Reads one tree of a `use`: `a::b`, `a as b`, `a::{b, c}`, `a::*`.
    fn read_import(&mut self, module: usize, tree: &[Token<'_>], before: &[String], is_export: bool) {
        let mut path = before.to_vec();
        let mut at = 0;
        while let Some(token) = tree.get(at) {
            match token.text {
                "::" => {}
                "{" => {
                    let inner = &tree[at + 1..tokens::group_end(tree, at) - 1];
                    let mut from = 0;
                    while from < inner.len() {
                        let mut end = from;
                        while end < inner.len() && inner[end].text != "," {
                            end =
                                if inner[end].text == "{" { tokens::group_end(inner, end) } else { end + 1 };
                        }
                        self.read_import(module, &inner[from..end], &path, is_export);
                        from = end + 1;
                    }
                    return;
                }
                "as" => break,
                text => path.push(text.to_owned()),
            }
            at += 1;
        }
        if path.last().is_some_and(|last| last == "self") && path.len() > 1 {
            path.pop();
        }
        let renamed = tree.get(at + 1).map(|t| t.text.to_owned());
        let Some(name) = renamed.or_else(|| path.last().cloned()) else { return };
        if name == "*" {
            path.pop();
        }
        self.0[module].imports.push(Import { name, path, is_export });
    }

    /// Collects the paths in code, and the imports in function bodies.
    fn read_code(&mut self, module: usize, code: &[Token<'_>]) {
        let mut at = 0;
        while at < code.len() {
            let before = if at == 0 { "" } else { code[at - 1].text };
            if code[at].kind != Kind::Word {
                at += 1;
            } else if code[at].text == "use" && before != "." {
                let end = code[at..].iter().position(|t| t.text == ";").map_or(code.len(), |i| at + i);
                // Not the `use<'a>` of a return type.
                if code.get(at + 1).is_some_and(|t| t.text != "<") {
                    self.read_import(module, &code[at + 1..end], &[], false);
                    at = end;
                }
                at += 1;
            } else {
                let mut path = vec![code[at].text.to_owned()];
                let mut end = at + 1;
                while code.get(end).is_some_and(|t| t.text == "::")
                    && code.get(end + 1).is_some_and(|t| t.kind == Kind::Word)
                {
                    path.push(code[end + 1].text.to_owned());
                    end += 2;
                }
                let called = code.get(end).is_some_and(|t| matches!(t.text, "(" | "!"));
                let is_name = path.len() > 1 || called || path[0].starts_with(char::is_uppercase);
                if is_name && !matches!(before, "." | "fn" | "::") {
                    self.0[module].paths.push(path);
                }
                at = end;
            }
        }
    }

    fn resolve(&self, module: usize, path: &[String], depth: usize) -> Option<Target> {
        // Imports that name each other end here.
        if depth > 16 {
            return None;
        }
        let (mut here, mut rest) = (module, path);
        let mut inside = false;
        while let Some(first) = rest.first() {
            match first.as_str() {
                "crate" => here = 0,
                "super" => here = self.0[here].parent,
                "self" => {}
                _ => break,
            }
            (inside, rest) = (true, &rest[1..]);
        }
        let mut target = Target::Module(here);
        for (i, name) in rest.iter().enumerate() {
            let Target::Module(at) = target else { return Some(target) };
            let is_last = i + 1 == rest.len();
            target = match self.resolve_name(at, name, is_last, depth) {
                Some(target) => target,
                // A name in a module of this crate that no line defines: a macro makes it.
                None if inside || i > 0 => Target::Item(at),
                None => return None,
            };
        }
        Some(target)
    }

    fn resolve_name(&self, module: usize, name: &str, is_last: bool, depth: usize) -> Option<Target> {
        let Module { children, items, imports, .. } = &self.0[module];
        let child = children.get(name).map(|&child| Target::Module(child));
        if items.contains(name) && (is_last || child.is_none()) {
            return Some(Target::Item(module));
        }
        let import = || {
            let mut named = imports.iter().filter(|import| import.name == name);
            // `use client;` names itself: an external crate.
            named.find_map(|i| if i.path == [name] { None } else { self.resolve(module, &i.path, depth + 1) })
        };
        let glob = || {
            let mut globs = imports.iter().filter(|import| import.name == "*");
            globs.find_map(|i| match self.resolve(module, &i.path, depth + 1)? {
                Target::Module(at) if at != module && depth < 8 => {
                    self.resolve_name(at, name, is_last, depth + 1)
                }
                _ => None,
            })
        };
        child.or_else(import).or_else(glob)
    }

    fn edges(&self) -> Edges {
        let mut edges = Edges::new();
        for (module, Module { file, imports, paths, .. }) in self.0.iter().enumerate() {
            let used = edges.entry(file.clone()).or_default();
            let imported = imports.iter().filter(|i| !i.is_export && i.name != "*").map(|i| &i.path);
            for path in imported.chain(paths) {
                if let Some(Target::Item(at)) = self.resolve(module, path, 0)
                    && self.0[at].file != *file
                {
                    used.entry(self.0[at].file.clone()).or_default().insert(path.join("::"));
                }
            }
        }
        edges
    }
}

/// Index behind an item: behind its body, or behind its `;` where it has an initial value.
fn item_or_statement_end(tokens: &[Token<'_>], start: usize) -> usize {
    let (mut may_have_value, mut has_value) = (true, false);
    let mut at = start;
    while let Some(token) = tokens.get(at) {
        match token.text {
            // The `=` of `where I: Iterator<Item = T>` begins no value.
            "fn" | "impl" | "struct" | "enum" | "trait" => {
                may_have_value = has_value;
                at += 1;
            }
            _ if token.kind != Kind::Mark => at += 1,
            ";" => return at + 1,
            "=" => {
                has_value = may_have_value;
                at += 1;
            }
            "{" if !has_value => return tokens::group_end(tokens, at),
            "(" | "[" | "{" => at = tokens::group_end(tokens, at),
            _ => at += 1,
        }
    }
    tokens.len()
}

/// The name that an item defines.
fn defined(item: &[Token<'_>]) -> Option<String> {
    let keyword = item.iter().position(|token| {
        matches!(
            token.text,
            "struct"
                | "enum"
                | "union"
                | "trait"
                | "type"
                | "fn"
                | "static"
                | "const"
                | "macro_rules"
                | "impl"
        )
    })?;
    let words = item[keyword..].iter().filter(|token| token.kind == Kind::Word).map(|token| token.text);
    let mut words = words.skip_while(|word| matches!(*word, "const" | "unsafe" | "async" | "extern" | "mut"));
    let first = words.next()?;
    match first {
        "impl" => None,
        "struct" | "enum" | "union" | "trait" | "type" | "fn" | "macro_rules" => {
            words.next().map(str::to_owned)
        }
        "static" => words.find(|word| *word != "mut").map(str::to_owned),
        // What stood behind `const`.
        name => Some(name.to_owned()),
    }
}

/// Edges between the rooms of each folder: the files and folders in it. A file is in one room with the folder of its
/// children. Files outside of the crate's folder are in none.
pub(crate) fn rooms(edges: &Edges) -> Vec<Edges> {
    let mut folders: BTreeMap<&Path, Edges> = BTreeMap::new();
    for (file, used) in edges {
        for (other, names) in used {
            if [file, other].iter().any(|path| path.components().any(|part| part == Component::ParentDir)) {
                continue;
            }
            let shared = file.ancestors().find(|folder| other.starts_with(folder)).unwrap();
            let room = |path: &Path| -> PathBuf {
                path.ancestors().take_while(|at| *at != shared).last().unwrap().with_extension("")
            };
            if room(file) == room(other) {
                continue;
            }
            let folder = folders.entry(shared).or_default();
            folder.entry(room(other)).or_default();
            folder.entry(room(file)).or_default().entry(room(other)).or_default().extend(names.clone());
        }
    }
    folders.into_values().collect()
}

/// The groups of files or rooms that all use each other, each with a shortest cycle through its first one that
/// lies on one.
pub(crate) fn cycles(edges: &Edges) -> Vec<(BTreeSet<PathBuf>, Vec<PathBuf>)> {
    let reached: BTreeMap<&PathBuf, BTreeMap<&PathBuf, &PathBuf>> =
        edges.keys().map(|file| (file, search(edges, file))).collect();
    let mut found: Vec<(BTreeSet<PathBuf>, Vec<PathBuf>)> = Vec::new();
    for (file, from) in &reached {
        if !from.contains_key(file) || found.iter().any(|(group, _)| group.contains(*file)) {
            continue;
        }
        let mutual = from.keys().filter(|other| reached[**other].contains_key(file));
        let group: BTreeSet<PathBuf> = mutual.map(|path| (*path).clone()).collect();
        let mut example = vec![(*file).clone()];
        let mut at = from[file];
        while at != *file {
            example.push(at.clone());
            at = from[at];
        }
        example.push((*file).clone());
        example.reverse();
        found.push((group, example));
    }
    found
}

/// The files that `start` reaches, each with its predecessor on a shortest way.
fn search<'a>(edges: &'a Edges, start: &'a PathBuf) -> BTreeMap<&'a PathBuf, &'a PathBuf> {
    let mut before = BTreeMap::new();
    let mut queue = VecDeque::from([start]);
    while let Some(file) = queue.pop_front() {
        for used in edges.get(file).into_iter().flat_map(BTreeMap::keys) {
            before.entry(used).or_insert_with(|| {
                queue.push_back(used);
                file
            });
        }
    }
    before
}

/// The roots of the crates under a `src` folder.
pub(crate) fn roots(src: &Path) -> Vec<PathBuf> {
    let mut roots: Vec<PathBuf> =
        ["lib.rs", "main.rs"].map(|name| src.join(name)).into_iter().filter(|file| file.is_file()).collect();
    let programs = fs::read_dir(src.join("bin")).into_iter().flatten();
    roots.extend(
        programs.map(|entry| entry.unwrap().path()).filter(|p| p.extension().is_some_and(|e| e == "rs")),
    );
    roots.sort();
    roots
}
