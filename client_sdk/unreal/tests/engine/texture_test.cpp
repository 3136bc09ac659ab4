#include "TerraportTexture.h"

#include "IImageWrapperModule.h"
#include "TextureResource.h"

#include "../ktx2_file.h"

#include <doctest/doctest.h>

namespace
{
/// Decodes anything to one image.
class FFakeImages final : public IImageWrapperModule
{
public:
	FFakeImages(int32 InWidth, int32 InHeight) : Width(InWidth), Height(InHeight) { Stub = this; }
	virtual ~FFakeImages() override { Stub = nullptr; }
	virtual bool DecompressImage(const void* Bytes, int64 Size, FImage& Image) override
	{
		First = Size > 0 ? static_cast<const uint8*>(Bytes)[0] : 0;
		Image.SizeX = Width;
		Image.SizeY = Height;
		Image.RawData.SetNumUninitialized(int64(Width) * Height * 4);
		for (int64 At = 0; At < Image.RawData.Num(); ++At)
		{
			Image.RawData[At] = (At / 4) % 2 == 0 ? 0 : 255;
		}
		return bReads;
	}
	int32 Width, Height;
	bool bReads = true;
	uint8 First = 0;
};

terraport::PayloadImage ImageOf(std::uint32_t Width, std::uint32_t Height)
{
	terraport::PayloadImage Image;
	Image.type = terraport::ImageType::Jpeg;
	Image.width = Width;
	Image.height = Height;
	Image.offset = 2;
	Image.bytes = 3;
	return Image;
}

const std::vector<std::uint8_t> Payload{9, 9, 42, 9, 9};
} // namespace

TEST_CASE("mips reach one pixel, and their means are of light, not of bytes")
{
	FFakeImages Images(4, 2);
	const FTerraportPixels Pixels = TerraportTexture::Decode(ImageOf(4, 2), terraport::viewOf(Payload));
	CHECK(Images.First == 42);
	REQUIRE(Pixels.Mips.size() == 3);
	CHECK(Pixels.Mips[1].Num() == 8);
	CHECK(Pixels.Mips[2].Num() == 4);
	// Half of the light of 255 is level 188 of sRGB; the mean of the bytes would be 128.
	CHECK(int(Pixels.Mips[1][0]) == 188);
	CHECK(int(Pixels.Mips[2][0]) == 188);
	CHECK(int(Pixels.Mips[1][3]) == 255);
}

TEST_CASE("an image that lied of its sides, cannot be read, or has no reader is none")
{
	{
		FFakeImages Images(4, 4);
		CHECK(TerraportTexture::Decode(ImageOf(4, 2), terraport::viewOf(Payload)).IsEmpty());
	}
	{
		FFakeImages Images(4, 2);
		Images.bReads = false;
		CHECK(TerraportTexture::Decode(ImageOf(4, 2), terraport::viewOf(Payload)).IsEmpty());
		Images.bReads = true;
		for (const terraport::ImageType Type : {terraport::ImageType::Ktx2, terraport::ImageType::Webp})
		{
			terraport::PayloadImage Other = ImageOf(4, 4);
			Other.type = Type;
			CHECK(TerraportTexture::Decode(Other, terraport::viewOf(Payload)).IsEmpty());
		}
	}
	CHECK(TerraportTexture::Decode(ImageOf(4, 2), terraport::viewOf(Payload)).IsEmpty());
}

TEST_CASE("a KTX2 stays compressed, in what the device's graphics have")
{
	const std::vector<std::uint8_t> File = bytesOfHex(kFile);
	terraport::PayloadImage Image = ImageOf(16, 8);
	Image.type = terraport::ImageType::Ktx2;
	Image.offset = 0;
	Image.bytes = File.size();
	FTerraportPixels Pixels = TerraportTexture::Decode(Image, terraport::viewOf(File));
	CHECK(Pixels.Format == PF_DXT1);
	REQUIRE(Pixels.Mips.size() == 5);
	CHECK(Pixels.Mips[0].Num() == 64);
	CHECK(Pixels.Mips[4].Num() == 8);
	const UTexture2D* Texture = TerraportTexture::MakeTexture(Pixels);
	REQUIRE(Texture != nullptr);
	CHECK(Texture->StubFormat == PF_DXT1);
	CHECK(Texture->StubData->Mips.Num() == 5);
	GPixelFormats[PF_DXT1].Supported = false;
	CHECK(TerraportTexture::Decode(Image, terraport::viewOf(File)).Format == PF_ETC2_RGB);
	GPixelFormats[PF_ETC2_RGB].Supported = false;
	CHECK(TerraportTexture::Decode(Image, terraport::viewOf(File)).IsEmpty());
	GPixelFormats[PF_DXT1].Supported = GPixelFormats[PF_ETC2_RGB].Supported = true;
	Image.bytes -= 1;
	CHECK(TerraportTexture::Decode(Image, terraport::viewOf(File)).IsEmpty());
}

TEST_CASE("a texture holds every mip")
{
	FFakeImages Images(8, 8);
	FTerraportPixels Pixels = TerraportTexture::Decode(ImageOf(8, 8), terraport::viewOf(Payload));
	UTexture2D* Texture = TerraportTexture::MakeTexture(Pixels);
	REQUIRE(Texture != nullptr);
	CHECK(Pixels.IsEmpty());
	CHECK(Texture->bStubUpdated);
	REQUIRE(Texture->GetPlatformData()->Mips.Num() == 4);
	CHECK(Texture->GetPlatformData()->Mips[0].BulkData.StubBytes.size() == 256);
	CHECK(Texture->GetPlatformData()->Mips[3].BulkData.StubBytes.size() == 4);
	CHECK(Texture->GetPlatformData()->Mips[2].SizeX == 2);
	CHECK(TerraportTexture::MakeTexture(Pixels) == nullptr);
}
