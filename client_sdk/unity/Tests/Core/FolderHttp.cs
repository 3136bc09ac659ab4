using System;
using System.Collections.Generic;
using System.IO;
using System.Text;
using System.Threading;
using System.Threading.Tasks;
using Terraport.Json;

namespace Terraport.Tests
{
    /// <summary>A server of one scene out of a folder, without a network; bytes of its files can be damaged.</summary>
    internal sealed class FolderHttp : IHttp
    {
        private readonly string folder;

        internal FolderHttp(string folder) { this.folder = folder; }

        /// <summary>Name of the file whose last byte is flipped; null for none.</summary>
        internal string Damaged { get; set; }

        /// <summary>Bearer token that it asks for; null for none.</summary>
        internal string Token { get; set; }

        internal readonly List<string> Urls = new List<string>();

        public Task<HttpAnswer> GetAsync(string url, string token, int maxBytes, Action<int> onBytes, CancellationToken cancelled)
        {
            cancelled.ThrowIfCancellationRequested();
            Urls.Add(url);
            if (Token != null && token != Token)
            {
                return Answer(401, Encoding.UTF8.GetBytes("{\"error\":{\"code\":\"unauthorised\",\"message\":\"no such token\"}}"));
            }
            string path = new Uri(url).AbsolutePath.Trim('/');
            string name = path.Substring(path.LastIndexOf('/') + 1);
            if (path == "scenes")
            {
                return Answer(200, Encoding.UTF8.GetBytes("{\"scenes\":[{\"id\":\"tiny\",\"version\":\"1\",\"name\":\"\"}]}"));
            }
            string file = name == "tiny" ? "scene.json" : name == "labels.json" ? name : PathOf(name);
            string filePath = Path.Combine(folder, file ?? "");
            if (file == null || !File.Exists(filePath))
            {
                // A proxy's page, not the server's JSON: the client must do with the status.
                return Answer(404, Encoding.UTF8.GetBytes("<html>not here</html>"));
            }
            byte[] body = File.ReadAllBytes(filePath);
            if (name == Damaged)
            {
                // One bit of the last byte: only the hash can tell.
                body[body.Length - 1] ^= 1;
            }
            if (onBytes != null)
            {
                onBytes(body.Length);
            }
            return Answer(200, body);
        }

        private static Task<HttpAnswer> Answer(int status, byte[] body)
        {
            return Task.FromResult(new HttpAnswer(status, body, body.Length));
        }

        private string PathOf(string key)
        {
            byte[] manifest = File.ReadAllBytes(Path.Combine(folder, "scene.json"));
            return JsonReader
                .Read(new ArraySegment<byte>(manifest)) ["files"]
                [key]["path"]
                .Text;
        }
    }
}
