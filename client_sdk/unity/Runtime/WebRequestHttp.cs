using System;
using System.Threading;
using System.Threading.Tasks;
using UnityEngine.Networking;

namespace Terraport.Unity
{
    /// <summary>
    /// Files by Unity's own web requests: where .NET's client does not work (WebGL), or where a project wants Unity's certificates. Main
    /// thread. In a browser redirects are followed all the same; the browser then takes the token off where the origin changes.
    /// </summary>
    public sealed class WebRequestHttp : IHttp
    {
        /// <inheritdoc/>
        public async Task<HttpAnswer> GetAsync(string url, string token, int maxBytes, Action<int> onBytes, CancellationToken cancelled)
        {
            cancelled.ThrowIfCancellationRequested();
            using (UnityWebRequest request = new UnityWebRequest(url, UnityWebRequest.kHttpVerbGET))
            {
                BoundedDownload download = new BoundedDownload(maxBytes, onBytes);
                request.downloadHandler = download;
                request.redirectLimit = 0;
                if (!string.IsNullOrEmpty(token))
                {
                    request.SetRequestHeader("Authorization", "Bearer " + token);
                }
                // Awaited by its event: UnityWebRequest has no task of its own in Unity 2021, and polling would need a component.
                TaskCompletionSource<bool> completion = new TaskCompletionSource<bool>();
                UnityWebRequestAsyncOperation sending = request.SendWebRequest();
                sending.completed +=
                    _ => completion.TrySetResult(true);
                using (cancelled.Register(request.Abort)) { await completion.Task; }
                cancelled.ThrowIfCancellationRequested();
                if (download.IsTooLong)
                {
                    throw new TerraportException("damaged", url + " has more than " + maxBytes + " bytes, expected at most that");
                }
                // No HTTP answer at all: name, address, certificate or network.
                if (request.responseCode == 0)
                {
                    string text = "no answer from " + url + " (" + request.error + "); is the server running, and reachable from here?";
                    throw new TerraportException("unreachable", text);
                }
                return new HttpAnswer((int)request.responseCode, download.Body, download.Length);
            }
        }

        /// <summary>Gathers a body up to a bound, and ends the request where more comes.</summary>
        private sealed class BoundedDownload : DownloadHandlerScript
        {
            private const int ChunkBytes = 65536;

            private readonly int maxBytes;
            private readonly Action<int> onBytes;

            public BoundedDownload(int maxBytes, Action<int> onBytes) : base(new byte[ChunkBytes])
            {
                this.maxBytes = maxBytes;
                this.onBytes = onBytes;
            }

            public byte[] Body { get; private set; } = new byte[ChunkBytes];

            public int Length { get; private set; }

            public bool IsTooLong { get; private set; }

            protected override bool ReceiveData(byte[] data, int dataLength)
            {
                // Returning false ends the request; its own error text would not say why, the flag does.
                if (dataLength > maxBytes - Length)
                {
                    IsTooLong = true;
                    return false;
                }
                if (Length + dataLength > Body.Length)
                {
                    // Doubled, but never beyond the bound: a server that sends on and on cannot make it larger.
                    byte[] longer = new byte[(int)Math.Min(Math.Max(2L * Body.Length, Length + dataLength), maxBytes)];
                    Buffer.BlockCopy(Body, 0, longer, 0, Length);
                    Body = longer;
                }
                Buffer.BlockCopy(data, 0, Body, Length, dataLength);
                Length += dataLength;
                if (onBytes != null)
                {
                    onBytes(dataLength);
                }
                return true;
            }
        }
    }
}
