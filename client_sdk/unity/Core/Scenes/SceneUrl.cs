using System;

namespace Terraport
{
    /// <summary>
    /// Scene URLs, in every form that a user may paste, to the addresses behind them (wire protocol, section 2.1).
    /// </summary>
    public sealed class SceneUrl
    {
        private const string Folder = "/scenes";

        private SceneUrl(string server, string scene)
        {
            Server = server;
            Scene = scene;
        }

        /// <summary>http(s)://host[:port][/prefix] without a slash at the end.</summary>
        public string Server { get; }

        /// <summary>Scene id; null for a server URL, whose only scene is meant.</summary>
        public string Scene { get; }

        /// <summary>Address of the server's list of scenes.</summary>
        public string ScenesUrl => Server + Folder;

        /// <summary>Address of the scene over HTTP, without a slash at the end.</summary>
        /// <exception cref="TerraportException">invalid_url: it names no scene.</exception>
        public string HttpUrl
        {
            get {
                if (Scene == null) throw Invalid(Server + " names no scene, expected .../scenes/ID");
                return ScenesUrl + "/" + Uri.EscapeDataString(Scene);
            }
        }

        /// <summary>Address of the scene's WebSocket.</summary>
        /// <exception cref="TerraportException">invalid_url: it names no scene.</exception>
        public string StreamUrl => "ws" + HttpUrl.Substring("http".Length) + "/stream";

        /// <summary>Read a scene URL or a server URL.</summary>
        /// <exception cref="TerraportException">invalid_url: neither, or with credentials, a query or a fragment.</exception>
        public static SceneUrl Parse(string url)
        {
            Uri uri;
            // 1. Scheme and host, by hand: Uri accepts more (file:, a missing host) than a scene URL may have.
            int schemeEnd = url == null ? -1 : url.IndexOf("://", StringComparison.Ordinal);
            string scheme = schemeEnd < 0 ? null : HttpOf(url.Substring(0, schemeEnd).ToLowerInvariant());
            bool hasHost = schemeEnd >= 0 && schemeEnd + 3 < url.Length && url[schemeEnd + 3] != '/';
            if (scheme == null || !hasHost || !Uri.TryCreate(url.Trim(), UriKind.Absolute, out uri) || uri.Host.Length == 0)
            {
                throw Invalid("URL \"" + url + "\", expected http(s)://host[:port][/prefix]/scenes/ID (or ws, wss)");
            }
            if (uri.UserInfo.Length > 0 || url.IndexOf('?') >= 0 || url.IndexOf('#') >= 0 || url.IndexOf('@') >= 0)
            {
                // The URL itself is not repeated: it may hold a secret.
                throw Invalid("URL of " + uri.Host + " has credentials, a query or a fragment, expected none of them");
            }
            // 2. ws and wss become http and https; a port is kept only where it is not the scheme's own.
            string origin = scheme + "://" + uri.Host + (uri.IsDefaultPort ? "" : ":" + uri.Port);
            string path = uri.AbsolutePath;
            // 3. [/prefix]/scenes/ID, also with the /stream of a WebSocket URL that was pasted.
            int folderAt = path.IndexOf(Folder, StringComparison.Ordinal);
            string prefix = folderAt < 0 ? path : path.Substring(0, folderAt);
            string belowFolder = folderAt < 0 ? "" : path.Substring(folderAt + Folder.Length);
            string scene = belowFolder.Trim('/');
            if (scene.EndsWith("/stream", StringComparison.Ordinal)) scene = scene.Substring(0, scene.Length - "/stream".Length);
            if (scene.Length == 0) return new SceneUrl(origin + prefix.TrimEnd('/'), null);
            if (scene.IndexOf('/') >= 0 || belowFolder[0] != '/')
            {
                throw Invalid("URL path \"" + path + "\", expected [/prefix]/scenes/ID");
            }
            return new SceneUrl(origin + prefix, Uri.UnescapeDataString(scene));
        }

        /// <summary>The URL of a scene of the same server, by its id.</summary>
        public SceneUrl With(string scene) { return new SceneUrl(Server, scene); }

        private static string HttpOf(string scheme)
        {
            switch (scheme)
            {
                case "http":
                case "ws": return "http";
                case "https":
                case "wss": return "https";
                default: return null;
            }
        }

        private static TerraportException Invalid(string text) { return new TerraportException("invalid_url", text); }
    }
}
