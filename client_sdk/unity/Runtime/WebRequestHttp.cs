#if UNITY_WEBGL && !UNITY_EDITOR
using System;
using System.Threading;
using System.Threading.Tasks;
using UnityEngine.Networking;

namespace Terraport.Unity
{
    /// <summary>
    /// Files by Unity's own web requests, where .NET's client does not work. In a browser redirects are followed; the browser takes the token
    /// off where the origin changes.
    /// </summary>
    internal sealed class WebRequestHttp : IHttp
    {
        public async Task<HttpAnswer> GetAsync(string url, string token, int maxBytes, CancellationToken cancelled)
        {
            using (UnityWebRequest request = UnityWebRequest.Get(url))
            {
                request.redirectLimit = 0;
                if (!string.IsNullOrEmpty(token)) request.SetRequestHeader("Authorization", "Bearer " + token);
                // UnityWebRequest has no task of its own before Unity 2023.
                var completion = new TaskCompletionSource<bool>();
                request.SendWebRequest().completed +=
                    _ => completion.TrySetResult(true);
                using (cancelled.Register(request.Abort)) await completion.Task;
                cancelled.ThrowIfCancellationRequested();
                byte[] body = request.downloadHandler.data ?? Array.Empty<byte>();
                if (body.Length > maxBytes)
                    throw new TerraportException("damaged", url + " has " + body.Length + " bytes, expected at most " + maxBytes);
                if (request.responseCode == 0)
                {
                    string text = "no answer from " + url + " (" + request.error + "); is the server running, and reachable from here?";
                    throw new TerraportException("unreachable", text);
                }
                return new HttpAnswer { Status = (int)request.responseCode, Body = new ArraySegment<byte>(body) };
            }
        }
    }
}
#endif
