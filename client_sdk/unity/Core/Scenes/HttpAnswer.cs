namespace Terraport
{
    /// <summary>What a server answered to one request, whatever its status.</summary>
    public sealed class HttpAnswer
    {
        /// <summary>An answer whose body is the first <paramref name="length"/> bytes of the array, which is kept, not copied.</summary>
        public HttpAnswer(int status, byte[] body, int length)
        {
            Status = status;
            Body = body;
            Length = length;
        }

        /// <summary>HTTP status.</summary>
        public int Status { get; private set; }

        /// <summary>The body; may be longer than <see cref="Length"/>.</summary>
        public byte[] Body { get; private set; }

        /// <summary>Bytes of the body.</summary>
        public int Length { get; private set; }
    }
}
