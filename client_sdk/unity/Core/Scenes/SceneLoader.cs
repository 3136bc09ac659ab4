using System;
using System.Collections.Generic;
using System.Threading;
using System.Threading.Tasks;
using Terraport.Json;

namespace Terraport
{
    /// <summary>
    /// Fetches what is loaded once for a version of a scene: manifest, base mesh, cover, names of the regions. Every file is
    /// compared with its hash. Starts no thread; continuations come back on the caller's context.
    /// </summary>
    public static class SceneLoader
    {
        private const int MaxJsonBytes = 1 << 24;
        private const int MaxLabelBytes = 1 << 26;

        /// <summary>Load everything of a scene that is loaded once; a few MiB to some tens of MiB.</summary>
        /// <param name="url">Scene URL; or a server URL, whose only scene is meant.</param>
        /// <param name="token">Bearer token; null or empty without.</param>
        /// <param name="http">How files are fetched; null for .NET's own client.</param>
        /// <param name="onProgress">Told of bytes that came, and of all, on whatever thread; may be null.</param>
        /// <param name="cancelled">Ends it.</param>
        /// <param name="version">Scene version; null for the newest.</param>
        /// <param name="aside">Runs hashing and decoding elsewhere, for example on a pool's thread; null for here.</param>
        /// <exception cref="TerraportException">
        /// The server's code where it refuses; "unreachable", "damaged", "unsupported_version", "invalid_url", "several_scenes".
        /// </exception>
        /// <exception cref="OperationCanceledException">It was cancelled.</exception>
        public static async Task<SceneFiles> LoadAsync(string url, string token, IHttp http = null, Action<long, long> onProgress = null,
            CancellationToken cancelled = default(CancellationToken), string version = null, Func<Action, Task> aside = null)
        {
            // No ConfigureAwait here: continuations belong on the caller's context, which in an engine is the main thread.
            var fetch = new SceneFetch(http ?? new SystemHttp(), token, onProgress, cancelled, aside);
            string sceneUrl = await ResolveAsync(url, token, http, cancelled);
            SceneManifest manifest = await FetchManifestAsync(fetch, sceneUrl, version);
            for (int attempt = 0;; attempt++)
            {
                TerraportException failure;
                try
                {
                    return await LoadVersionAsync(fetch, sceneUrl, manifest, aside);
                }
                catch (TerraportException error)
                {
                    // Published anew between the manifest and its files (scene format, section 2): start over, once.
                    if (attempt > 0 || version != null || (error.CloseCode != 404 && error.Code != "damaged"))
                    {
                        throw;
                    }
                    failure = error;
                }
                SceneManifest newer = await FetchManifestAsync(fetch, sceneUrl, null);
                if (newer.Version == manifest.Version)
                {
                    throw failure;
                }
                manifest = newer;
            }
        }

        /// <summary>The scenes that a token opens.</summary>
        /// <exception cref="TerraportException">As <see cref="LoadAsync"/>.</exception>
        public static async Task<IReadOnlyList<SceneSummary>> ListAsync(
            string serverUrl, string token, IHttp http = null, CancellationToken cancelled = default(CancellationToken))
        {
            SceneUrl server = SceneUrl.Parse(serverUrl);
            var fetch = new SceneFetch(http ?? new SystemHttp(), token, null, cancelled);
            ArraySegment<byte> text = await fetch.GetAsync(server.ScenesUrl, MaxJsonBytes);
            JsonValue rows;
            try
            {
                rows = JsonReader.Read(text)["scenes"];
            }
            catch (JsonException error)
            {
                throw new TerraportException("damaged", server.ScenesUrl + " is no JSON; is this a terraport server?", 200, error);
            }
            // JSON, but no list: another service answers at this address.
            if (rows.Kind != JsonKind.List)
            {
                throw new TerraportException("damaged", server.ScenesUrl + " lists no scenes; is this a terraport server?");
            }
            var scenes = new SceneSummary[rows.Count];
            for (int at = 0; at < scenes.Length; at++)
            {
                string id = rows[at]["id"].Text;
                string name = rows[at]["name"].Text;
                if (string.IsNullOrEmpty(id) || rows[at]["version"].Text == null)
                {
                    throw new TerraportException("damaged", server.ScenesUrl + " lists a scene without id or version");
                }
                string address = server.ScenesUrl + "/" + Uri.EscapeDataString(id);
                // A scene without a name is shown by its id.
                scenes[at] = new SceneSummary(id, string.IsNullOrEmpty(name) ? id : name, rows[at]["version"].Text, address);
            }
            return scenes;
        }

        private static async Task<string> ResolveAsync(string url, string token, IHttp http, CancellationToken cancelled)
        {
            SceneUrl address = SceneUrl.Parse(url);
            if (address.Scene != null)
            {
                return address.HttpUrl;
            }
            IReadOnlyList<SceneSummary> scenes = await ListAsync(url, token, http, cancelled);
            if (scenes.Count == 1)
            {
                return scenes[0].Url;
            }
            string text = address.Server + " serves " + scenes.Count + " scenes, expected one: name it as .../scenes/ID";
            throw new TerraportException("several_scenes", text);
        }

        private static async Task<SceneManifest> FetchManifestAsync(SceneFetch fetch, string sceneUrl, string version)
        {
            ArraySegment<byte> text = await fetch.GetAsync(Versioned(sceneUrl, version), MaxJsonBytes);
            return ManifestReader.Read(text, SceneUrl.Parse(sceneUrl).Scene);
        }

        private static async Task<SceneFiles> LoadVersionAsync(
            SceneFetch fetch, string sceneUrl, SceneManifest manifest, Func<Action, Task> aside)
        {
            fetch.Begin((long)manifest.BaseFile.Length + manifest.CoverFile.Length + manifest.RegionsFile.Length);
            string version = manifest.Version;
            // All at once: over a long link the waits overlap. Labels have no hash, since they change without a new version.
            Task<ArraySegment<byte>> glb = fetch.GetFileAsync(Versioned(sceneUrl + "/base.glb", version), manifest.BaseFile);
            Task<ArraySegment<byte>> cover = fetch.GetFileAsync(Versioned(sceneUrl + "/base.cover", version), manifest.CoverFile);
            Task<ArraySegment<byte>> regions = fetch.GetFileAsync(Versioned(sceneUrl + "/regions.json", version), manifest.RegionsFile);
            // Awaited together with the rest; it never throws for what the network does.
            Task<ArraySegment<byte>> labels = fetch.GetOptionalAsync(sceneUrl + "/labels.json", MaxLabelBytes);
            await Task.WhenAll(glb, cover, regions, labels);
            SceneFiles files = null;
            Action decode = () => files = Decode(manifest, glb.Result, cover.Result, regions.Result, labels.Result);
            if (aside == null)
            {
                decode();
            }
            else
            {
                await aside(decode);
            }
            return files;
        }

        private static SceneFiles Decode(
            SceneManifest manifest, ArraySegment<byte> glb, ArraySegment<byte> cover, ArraySegment<byte> regions, ArraySegment<byte> labels)
        {
            try
            {
                var mesh = new SegmentMesh();
                new GlbDecoder().Decode(glb, mesh);
                // Both files are whole, and yet may be of two builds: the cover is only valid over this very base.
                if (mesh.FaceCount != manifest.BaseFaces)
                {
                    throw new PayloadException("base of " + mesh.FaceCount + " faces, expected " + manifest.BaseFaces + " by the manifest");
                }
                Cover rows = CoverReader.Read(cover, mesh.FaceCount, manifest.SegmentCount);
                IReadOnlyList<RegionUnion> unions;
                IReadOnlyList<RegionFacts> facts = RegionsReader.Read(regions, labels, out unions);
                return new SceneFiles(manifest, mesh, rows, facts, unions);
            }
            catch (PayloadException error)
            {
                string scene = "scene " + manifest.Id + ", version " + manifest.Version;
                string text = scene + ": " + error.Message + "; it must be published anew";
                throw new TerraportException("damaged", text, null, error);
            }
        }

        private static string Versioned(string url, string version)
        {
            return version == null ? url : url + "?v=" + Uri.EscapeDataString(version);
        }
    }
}
