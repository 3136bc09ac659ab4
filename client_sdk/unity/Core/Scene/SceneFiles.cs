using System;
using System.Collections.Generic;
using System.Linq;
using System.Threading;
using System.Threading.Tasks;

namespace Terraport
{
    /// <summary>What is loaded once for a version of a scene: manifest, base mesh, regions.</summary>
    public sealed class SceneFiles
    {
        private const int MaxJsonBytes = 1 << 24, MaxRegionsBytes = 1 << 28, MaxBaseBytes = 1 << 30;

        private SceneFiles() {}

        /// <summary>What the scene says of itself.</summary>
        public SceneManifest Manifest { get; private set; }

        internal SceneUrl Url { get; private set; }

        /// <summary>The base mesh: its face f is bit f of a plan's hidden faces.</summary>
        internal SegmentMesh Base { get; private set; }

        /// <summary>The base mesh for rays.</summary>
        internal GroundMesh BaseGround { get; private set; }

        internal Regions Regions { get; private set; }

        /// <summary>What the renderer has prepared of the base, on a thread where there are any.</summary>
        internal object Prepared { get; private set; }

        /// <summary>Load the newest version of a scene.</summary>
        /// <param name="url">Scene URL; or a server URL, whose only scene is meant.</param>
        /// <param name="token">Bearer token; null or empty for none.</param>
        /// <param name="http">Fetches the files.</param>
        /// <param name="prepare">Prepares the base for drawing; null for nothing.</param>
        /// <param name="cancelled">Ends it.</param>
        /// <param name="runAside">Runs decoding elsewhere, for example on a pool's thread; null for here.</param>
        /// <exception cref="TerraportException">
        /// The server's code where it refuses; "unreachable", "damaged", "unsupported_version", "invalid_url", "several_scenes".
        /// </exception>
        internal static async Task<SceneFiles> LoadAsync(string url, string token, IHttp http, Func<SceneFiles, object> prepare = null,
            CancellationToken cancelled = default, Func<Action, Task> runAside = null)
        {
            // No ConfigureAwait: continuations come back on the caller's context, which in an engine is the main thread.
            Func<string, int, Task<ArraySegment<byte>>> get = async (address, maxBytes) =>
                BodyOf(address, await http.GetAsync(address, token, maxBytes, cancelled));
            SceneUrl scene = SceneUrl.Parse(url);
            if (scene.Scene == null) scene = scene.With(OnlySceneOf(scene, await get(scene.ScenesUrl, MaxJsonBytes)));
            SceneManifest manifest = SceneManifest.Read(await get(scene.HttpUrl, MaxJsonBytes), scene.Scene);
            string version = "?v=" + Uri.EscapeDataString(manifest.Version);
            // All at once: over a long link the waits overlap.
            Task<ArraySegment<byte>> baseFile = get(scene.HttpUrl + "/base.tsg" + version, MaxBaseBytes);
            Task<ArraySegment<byte>> regions = get(scene.HttpUrl + "/regions.json" + version, MaxRegionsBytes);
            Task<ArraySegment<byte>> labels = GetOptionalAsync(get(scene.HttpUrl + "/labels.json", MaxRegionsBytes));
            await Task.WhenAll(baseFile, regions, labels);
            var files = new SceneFiles { Manifest = manifest, Url = scene };
            Action decode = () => files.Decode(baseFile.Result, regions.Result, labels.Result, prepare);
            if (runAside == null)
                decode();
            else
                await runAside(decode);
            return files;
        }

        private void Decode(
            ArraySegment<byte> baseFile, ArraySegment<byte> regions, ArraySegment<byte> labels, Func<SceneFiles, object> prepare)
        {
            try
            {
                Base = new SegmentMesh();
                new SegmentDecoder().Decode(baseFile, Manifest.Attributes.Count, Base, true);
                if (Base.FaceCount != Manifest.BaseFaces)
                    throw new PayloadException("got a base of " + Base.FaceCount + " faces, expected " + Manifest.BaseFaces);
                Regions = Regions.Read(regions, labels);
            }
            catch (PayloadException error)
            {
                string text =
                    "scene " + Manifest.Id + ", version " + Manifest.Version + ": " + error.Message + "; it must be published again";
                throw new TerraportException("damaged", text, null, error);
            }
            BaseGround = new GroundMesh(Base);
            Prepared = prepare?.Invoke(this);
        }

        private static string OnlySceneOf(SceneUrl server, ArraySegment<byte> text)
        {
            IReadOnlyList<Json> scenes = Json.Read(text)["scenes"].List;
            string id = scenes?.Count == 1 ? scenes[0]["id"].Text : null;
            if (id != null) return id;
            if (scenes == null) throw new TerraportException("damaged", server.ScenesUrl + " lists no scenes; is this a terraport server?");
            string names = string.Join(", ", scenes.Select(row => row["id"].Text));
            throw new TerraportException(
                "several_scenes", server.Server + " serves these scenes: " + names + "; name one as .../scenes/ID");
        }

        /// <summary>Fetch a file that is not needed; empty where that fails.</summary>
        private static async Task<ArraySegment<byte>> GetOptionalAsync(Task<ArraySegment<byte>> get)
        {
            try
            {
                return await get;
            }
            catch (TerraportException)
            {
                return new ArraySegment<byte>(Array.Empty<byte>());
            }
        }

        private static ArraySegment<byte> BodyOf(string url, HttpAnswer answer)
        {
            if (answer.Status >= 200 && answer.Status < 300) return answer.Body;
            Json error = default;
            try
            {
                error = Json.Read(answer.Body)["error"];
            }
            catch (PayloadException)
            {
                // A proxy's page, or nothing: the status says what there is to say.
            }
            string code = error["code"].Text ?? CloseCodes.ErrorOfHttp(answer.Status);
            string message = error["message"].Text ?? url + " was refused with HTTP status " + answer.Status;
            throw new TerraportException(code, message + CloseCodes.AdviceOn(code), answer.Status, null);
        }
    }
}
