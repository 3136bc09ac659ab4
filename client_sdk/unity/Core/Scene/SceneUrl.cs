using System;

namespace Terraport
{
    /// <summary>A scene URL, in every form that a user may paste, and the addresses that follow from it.</summary>
    internal sealed class SceneUrl
    {
        private const string Folder = "/scenes";

        private SceneUrl(string server, string scene)
        {
            Server = server;
            Scene = scene;
        }

        /// <summary>http(s)://host[:port][/prefix] without a slash at the end.</summary>
        internal string Server { get; }

        /// <summary>Scene id; null for a server URL, whose only scene is meant.</summary>
        internal string Scene { get; }

        /// <summary>Address of the server's list of scenes.</summary>
        internal string ScenesUrl => Server + Folder;

        /// <summary>Address of the scene, without a slash at the end.</summary>
        internal string HttpUrl => ScenesUrl + "/" + Uri.EscapeDataString(Scene);

        /// <summary>Address of the scene's WebSocket.</summary>
        internal string StreamUrl => "ws" + HttpUrl.Substring("http".Length) + "/stream";

        /// <summary>Read a scene URL or a server URL; ws and wss are http and https.</summary>
        /// <exception cref="TerraportException">invalid_url: neither, or with credentials, a query or a fragment.</exception>
        internal static SceneUrl Parse(string url)
        {
            bool isUrl = Uri.TryCreate((url ?? "").Trim(), UriKind.Absolute, out Uri uri) && uri.Host.Length > 0;
            string scheme = isUrl ? uri.Scheme.Replace("ws", "http") : "";
            if (scheme != "http" && scheme != "https")
                throw Invalid("got URL \"" + url + "\", expected http(s)://host[:port][/prefix]/scenes/ID");
            // The URL itself is not repeated: it may hold a secret.
            if (uri.UserInfo.Length > 0 || uri.Query.Length > 0 || uri.Fragment.Length > 0 || url.IndexOf('?') >= 0
                || url.IndexOf('@') >= 0)
                throw Invalid("got a URL of " + uri.Host + " with credentials, a query or a fragment, expected none of them");
            bool isUsualPort = uri.Port == (scheme == "https" ? 443 : 80) || uri.Port < 0;
            string origin = scheme + "://" + uri.Host + (isUsualPort ? "" : ":" + uri.Port), path = uri.AbsolutePath;
            // [/prefix]/scenes/ID, also with the /stream of a WebSocket URL that was pasted.
            int folderAt = path.IndexOf(Folder, StringComparison.Ordinal);
            string prefix = folderAt < 0 ? path : path.Substring(0, folderAt);
            string below = folderAt < 0 ? "" : path.Substring(folderAt + Folder.Length), scene = below.Trim('/');
            if (scene.EndsWith("/stream", StringComparison.Ordinal)) scene = scene.Substring(0, scene.Length - "/stream".Length);
            if (scene.Length == 0) return new SceneUrl(origin + prefix.TrimEnd('/'), null);
            if (scene.IndexOf('/') >= 0 || below[0] != '/') throw Invalid("got URL path \"" + path + "\", expected [/prefix]/scenes/ID");
            return new SceneUrl(origin + prefix, Uri.UnescapeDataString(scene));
        }

        /// <summary>The URL of a scene of the same server.</summary>
        internal SceneUrl With(string scene) { return new SceneUrl(Server, scene); }

        private static TerraportException Invalid(string text) { return new TerraportException("invalid_url", text); }
    }
}
