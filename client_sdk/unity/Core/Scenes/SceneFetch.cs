using System;
using System.Threading;
using System.Threading.Tasks;
using Terraport.Json;

namespace Terraport
{
    /// <summary>Files of a scene over HTTP, with the server's own words where it refuses.</summary>
    internal sealed class SceneFetch
    {
        private const int MaxErrorCharacters = 1024;
        private readonly IHttp http;
        private readonly string token;
        private readonly Action<long, long> onProgress;
        private readonly CancellationToken cancelled;
        private readonly Func<Action, Task> aside;
        private long receivedBytes;
        private long totalBytes;

        /// <remarks>aside: Runs the hashing elsewhere; null for here.</remarks>
        internal SceneFetch(
            IHttp http, string token, Action<long, long> onProgress, CancellationToken cancelled, Func<Action, Task> aside = null)
        {
            this.aside = aside;
            this.http = http;
            this.token = token;
            this.onProgress = onProgress;
            this.cancelled = cancelled;
        }

        /// <summary>Start the progress anew: 0 of <paramref name="bytes"/>.</summary>
        internal void Begin(long bytes)
        {
            receivedBytes = 0;
            totalBytes = bytes;
        }

        /// <summary>The body of a file of at most <paramref name="maxBytes"/>.</summary>
        /// <exception cref="TerraportException">The server's code where it refuses; "unreachable"; "damaged".</exception>
        internal async Task<ArraySegment<byte>> GetAsync(string url, int maxBytes)
        {
            return BodyOf(url, await http.GetAsync(url, token, maxBytes, null, cancelled));
        }

        /// <summary>A file whose length and hash the manifest states; both are compared.</summary>
        /// <exception cref="TerraportException">As <see cref="GetAsync"/>; "damaged" where length or hash differ.</exception>
        internal async Task<ArraySegment<byte>> GetFileAsync(string url, FileFacts facts)
        {
            Action<int> onBytes = onProgress == null ? (Action<int>)null : Count;
            // A refusal may be longer than a small file.
            int maxBytes = Math.Max(facts.Length, 1 << 16);
            ArraySegment<byte> body = BodyOf(url, await http.GetAsync(url, token, maxBytes, onBytes, cancelled));
            if (body.Count != facts.Length)
            {
                string message = url + " has " + body.Count + " bytes, expected " + facts.Length + " by the manifest; load it again";
                throw new TerraportException("damaged", message);
            }
            // Captured by the closure: with `aside` it is written on another thread, and read after that was awaited.
            ulong hash = 0;
            Action hashBody = () => hash = Xxh3.Hash64(body.Array, body.Offset, body.Count);
            if (aside == null)
            {
                hashBody();
            }
            else
            {
                await aside(hashBody); // Tens of MiB: on an engine's main thread that would be a frame lost.
            }
            if (hash != facts.Xxh3)
            {
                throw new TerraportException("damaged", url + " has another hash than the manifest says; load it again");
            }
            return body;
        }

        /// <summary>A file that may be absent, and without which all goes on: empty where it does not come.</summary>
        internal async Task<ArraySegment<byte>> GetOptionalAsync(string url, int maxBytes)
        {
            try
            {
                return await GetAsync(url, maxBytes);
            }
            catch (TerraportException)
            {
                return new ArraySegment<byte>(Array.Empty<byte>());
            }
        }

        private static ArraySegment<byte> BodyOf(string url, HttpAnswer answer)
        {
            var body = new ArraySegment<byte>(answer.Body, 0, answer.Length);
            if (answer.Status >= 200 && answer.Status < 300)
            {
                return body;
            }
            // The server's own error object if there is one; else what the status alone says.
            string code = null;
            string message = null;
            try
            {
                JsonValue error = JsonReader.Read(body)["error"];
                code = error["code"].Text;
                message = error["message"].Text;
            }
            catch (JsonException)
            {
                // A proxy's page, or nothing.
            }
            code = code ?? CodeOf(answer.Status);
            message = message ?? url + " was refused with HTTP status " + answer.Status;
            message = message.Length > MaxErrorCharacters ? message.Substring(0, MaxErrorCharacters) : message;
            throw new TerraportException(code, message + AdviceOn(code), answer.Status, null);
        }

        private static string CodeOf(int status)
        {
            switch (status)
            {
                case 401: return "unauthorised";
                case 403: return "forbidden";
                case 404: return "unknown_scene";
                case 429: return "too_many";
                case 503: return "draining";
                default: return "refused";
            }
        }

        /// <summary>What to do, where the server cannot know it.</summary>
        private static string AdviceOn(string code)
        {
            switch (code)
            {
                case "unauthorised": return "; give a token that the service knows";
                case "forbidden": return "; ask for a token that opens this scene";
                case "draining": return "; try again in a moment";
                default: return "";
            }
        }

        private void Count(int bytes) { onProgress(Interlocked.Add(ref receivedBytes, bytes), totalBytes); }
    }
}
